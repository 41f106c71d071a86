// Constants of the protocol in docs/protocol.md.
#pragma once
#include <stdint.h>

namespace palpate {

constexpr uint8_t kProtocolVersion = 2;
constexpr uint8_t kVersion[3] = {0, 2, 0};

#ifndef MAX_SIDE
#define MAX_SIDE 16
#endif
constexpr uint8_t kMaxSide = MAX_SIDE;
constexpr uint16_t kMaxPixels = kMaxSide * kMaxSide;
constexpr uint8_t kMaxOversampling = 64;
constexpr uint16_t kMinSettleUs = 5;
constexpr uint16_t kMaxSettleUs = 1000;
constexpr uint16_t kAdcFullScale = 1024;
constexpr uint8_t kLoadCells = 2;
constexpr int32_t kNoReading = INT32_MIN;

constexpr uint16_t kMaxPressurePa = 50000;
constexpr uint32_t kMaxSlewPaPerS = 500000;
constexpr uint16_t kHeartbeatMs = 500;

// Hobby servos accept at most 500 to 2500 us, and turn 60 degrees in 0.1 to 0.2 s.
constexpr uint16_t kShortestPulseUs = 500;
constexpr uint16_t kLongestPulseUs = 2500;
// Time for the servo to open after a trip before its supply is cut.
constexpr uint16_t kBackOffMs = 400;

enum Type : uint8_t {
  kFrame = 0x01,
  kAck = 0x02,
  kIdentity = 0x03,
  kIdentify = 0x81,
  kLayout = 0x82,
  kRate = 0x83,
  kOversampling = 0x84,
  kStart = 0x85,
  kStop = 0x86,
  kPing = 0x87,
  kPressure = 0x88,
  kCeiling = 0x89,
  kServoTravel = 0x8A,
  kServo = 0x8B,
};

enum Result : uint8_t { kOk, kUnknownCommand, kBadArgument, kTooFast, kStreaming, kTripped };

enum Contents : uint8_t { kWithLoadCells = 1, kWithPressure = 2, kWithServo = 4, kAllContents = 7 };

enum Status : uint8_t {
  kDropped = 0x01,
  kHeartbeatLost = 0x02,
  kCeilingTripped = 0x04,
  kLoadCellSilent = 0x08,
  kWatchdogReset = 0x10,
  kCommandDamaged = 0x20,
};

constexpr uint8_t kHeadBytes = 3;
constexpr uint8_t kCrcBytes = 4;
constexpr uint8_t kFrameHeadBytes = 13;
constexpr uint8_t kLoadBytes = 10;
constexpr uint8_t kPressureBytes = 4;
constexpr uint8_t kServoBytes = 2;
constexpr uint8_t kAckBytes = 16;
constexpr uint8_t kIdentityBytes = 36;

// Bytes on the line for a payload: head, CRC, COBS codes, final zero.
constexpr uint16_t stuffed_bytes(uint16_t payload) {
  return static_cast<uint16_t>(payload + kHeadBytes + kCrcBytes + 2 +
                               (payload + kHeadBytes + kCrcBytes) / 254);
}

constexpr uint16_t frame_payload_bytes(uint16_t pixels, uint8_t contents) {
  return static_cast<uint16_t>(kFrameHeadBytes + 2 * pixels +
                               ((contents & kWithLoadCells) ? kLoadBytes : 0) +
                               ((contents & kWithPressure) ? kPressureBytes : 0) +
                               ((contents & kWithServo) ? kServoBytes : 0));
}

constexpr uint16_t kMaxStuffedBytes = stuffed_bytes(frame_payload_bytes(kMaxPixels, kAllContents));
constexpr uint8_t kMaxCommandBytes = 32;

}  // namespace palpate
