// Packets with COBS framing, length and CRC-32, processed byte by byte in bounded memory.
#pragma once
#include <stdint.h>

#include "protocol.h"

namespace palpate {

class Crc32 {
 public:
  void add(uint8_t byte);
  uint32_t value() const { return ~state_; }

 private:
  uint32_t state_ = 0xFFFFFFFFu;
};

// Writes one packet into `out`, which must hold stuffed_bytes(payload) bytes.
class PacketWriter {
 public:
  PacketWriter(uint8_t* out, uint8_t type, uint16_t payload);
  void u8(uint8_t value);
  void u16(uint16_t value);
  void u32(uint32_t value);
  // Ends the packet; returns its size with the final zero.
  uint16_t finish();

 private:
  void stuff(uint8_t byte);

  uint8_t* out_;
  uint16_t code_at_ = 0;
  uint16_t end_ = 1;
  Crc32 crc_;
};

// A command as received.
struct Packet {
  uint8_t type;
  const uint8_t* payload;
  uint8_t size;
};

// Collects command packets from single bytes.
class PacketReader {
 public:
  enum Event : uint8_t { kNothing, kPacket, kDamaged };

  // After kPacket, packet() is valid until the next byte.
  Event feed(uint8_t byte);
  const Packet& packet() const { return packet_; }

 private:
  bool open();

  uint8_t bytes_[kMaxCommandBytes];
  uint8_t size_ = 0;
  bool overlong_ = false;
  bool in_step_ = false;
  Packet packet_ = {};
};

}  // namespace palpate
