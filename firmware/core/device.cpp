#include "device.h"

namespace palpate {

namespace {
uint16_t u16_at(const uint8_t* bytes) { return static_cast<uint16_t>(bytes[0] | bytes[1] << 8); }

uint32_t u32_at(const uint8_t* bytes) {
  return u16_at(bytes) | static_cast<uint32_t>(u16_at(bytes + 2)) << 16;
}

uint8_t text_length(const char* text) {
  uint8_t length = 0;
  while (text[length] != '\0') ++length;
  return length;
}

// Bytes after the tag; 0xFF for a command that doesn't exist.
uint8_t argument_bytes(uint8_t type) {
  switch (type) {
    case kIdentify:
    case kStop:
    case kPing:
      return 0;
    case kOversampling:
    case kStart:
      return 1;
    case kCeiling:
      return 2;
    case kLayout:
    case kRate:
      return 4;
    case kPressure:
      return 6;
    default:
      return 0xFF;
  }
}
}  // namespace

void Device::begin(uint8_t reset_cause, uint8_t seed, bool watchdog_since_power_up,
                   bool tripped) {
  reset_cause_ = reset_cause;
  stream_seed_ = seed;
  watchdog_ = watchdog_since_power_up;
  tripped_ = tripped;
  board_.set_pressure_output(0);
  // Until a host sets a ceiling.
  board_.set_safe_line(false);
  send_identity(0);
}

void Device::on_byte(uint8_t byte) {
  switch (reader_.feed(byte)) {
    case PacketReader::kPacket:
      obey(reader_.packet());
      break;
    case PacketReader::kDamaged:
      damaged_ = true;
      break;
    case PacketReader::kNothing:
      break;
  }
}

void Device::obey(const Packet& packet) {
  if (packet.size < 1) {
    damaged_ = true;
    return;
  }
  const Result result = execute(packet);
  if (result != kUnknownCommand) regulator_.heartbeat(board_.now_us());
  if (packet.type == kIdentify && result == kOk) {
    send_identity(packet.payload[0]);
  } else {
    send_ack(packet.type, packet.payload[0], result);
  }
}

Result Device::execute(const Packet& packet) {
  const uint8_t expected = argument_bytes(packet.type);
  if (expected == 0xFF) return kUnknownCommand;
  if (packet.size != 1 + expected) return kBadArgument;
  const bool configures = packet.type >= kLayout && packet.type <= kStart;
  if (configures && streaming_) return kStreaming;

  const uint8_t* arguments = packet.payload + 1;
  switch (packet.type) {
    case kLayout:
      return set_layout(arguments[0], arguments[1], u16_at(arguments + 2));
    case kRate:
      return set_rate(u32_at(arguments));
    case kOversampling:
      if (arguments[0] < 1 || arguments[0] > kMaxOversampling) return kBadArgument;
      plan_.oversampling = arguments[0];
      return kOk;
    case kStart:
      return start(arguments[0]);
    case kStop:
      streaming_ = false;
      board_.stop_scanning();
      return kOk;
    case kPressure:
      if (tripped_) return kTripped;
      return regulator_.set(u16_at(arguments), u32_at(arguments + 2)) ? kOk : kBadArgument;
    case kCeiling:
      if (u16_at(arguments) > kAdcMax) return kBadArgument;
      ceiling_ = u16_at(arguments);
      tripped_ = false;
      board_.set_safe_line(true);
      return kOk;
    default:
      return kOk;
  }
}

Result Device::set_layout(uint8_t rows, uint8_t cols, uint16_t settle_us) {
  if (rows < 1 || rows > kMaxSide || cols < 1 || cols > kMaxSide) return kBadArgument;
  if (settle_us < kMinSettleUs || settle_us > kMaxSettleUs) return kBadArgument;
  plan_.rows = rows;
  plan_.cols = cols;
  plan_.settle_us = settle_us;
  return kOk;
}

Result Device::set_rate(uint32_t rate_mhz) {
  if (rate_mhz < 100) return kBadArgument;
  if (rate_mhz > highest_rate_mhz(plan_, timing_)) return kTooFast;
  plan_.rate_mhz = rate_mhz;
  return kOk;
}

Result Device::start(uint8_t contents) {
  if (contents & ~kAllContents) return kBadArgument;
  plan_.contents = contents;
  if (plan_.rate_mhz > highest_rate_mhz(plan_, timing_)) return kTooFast;
  stream_seed_ = stream_seed_ == 0xFF ? 1 : static_cast<uint8_t>(stream_seed_ + 1);
  stream_ = stream_seed_;
  next_sequence_ = 0;
  streaming_ = true;
  board_.start_scanning(plan_);
  return kOk;
}

void Device::on_scan(const Scan& scan) {
  check_ceiling(scan);
  dropped_ = scan.sequence != next_sequence_;
  next_sequence_ = scan.sequence + 1;
  send_frame(board_.transmit_buffer(), scan);
  damaged_ = false;
}

void Device::check_ceiling(const Scan& scan) {
  if (ceiling_ == 0) return;
  const uint16_t limit = static_cast<uint16_t>(ceiling_ * plan_.oversampling);
  for (uint16_t pixel = 0; pixel < plan_.pixels(); ++pixel) {
    if (scan.counts[pixel] < limit) continue;
    tripped_ = true;
    regulator_.vent();
    board_.set_pressure_output(0);
    board_.set_safe_line(false);
    return;
  }
}

void Device::poll() { board_.set_pressure_output(regulator_.update(board_.now_us())); }

uint8_t Device::status() const {
  uint8_t bits = 0;
  if (dropped_) bits |= kDropped;
  if (regulator_.heartbeat_lost()) bits |= kHeartbeatLost;
  if (tripped_) bits |= kCeilingTripped;
  if (watchdog_) bits |= kWatchdogReset;
  if (damaged_) bits |= kCommandDamaged;
  if (plan_.contents & kWithLoadCells) {
    for (uint8_t i = 0; i < kLoadCells; ++i) {
      if (board_.load_cell(i).silent) bits |= kLoadCellSilent;
    }
  }
  return bits;
}

void Device::send_frame(uint8_t* out, const Scan& scan) {
  const uint16_t pixels = plan_.pixels();
  PacketWriter packet(out, kFrame, frame_payload_bytes(pixels, plan_.contents));
  packet.u32(scan.sequence);
  packet.u32(scan.time_us);
  packet.u8(stream_);
  packet.u8(plan_.oversampling);
  packet.u8(static_cast<uint8_t>((plan_.rows - 1) << 4 | (plan_.cols - 1)));
  packet.u8(plan_.contents);
  packet.u8(status());
  for (uint16_t pixel = 0; pixel < pixels; ++pixel) packet.u16(scan.counts[pixel]);
  if (plan_.contents & kWithLoadCells) {
    for (uint8_t i = 0; i < kLoadCells; ++i) {
      packet.u32(static_cast<uint32_t>(board_.load_cell(i).raw));
      packet.u8(board_.load_cell(i).sample);
    }
  }
  if (plan_.contents & kWithPressure) {
    packet.u16(regulator_.output_pa());
    packet.u16(static_cast<uint16_t>(static_cast<uint32_t>(scan.pressure_counts) *
                                     kMaxPressurePa / kAdcMax));
  }
  board_.transmit(packet.finish());
}

void Device::send_ack(uint8_t command, uint8_t tag, Result result) {
  PacketWriter packet(board_.transmit_buffer(), kAck, kAckBytes);
  packet.u8(command);
  packet.u8(tag);
  packet.u8(result);
  packet.u8(stream_);
  packet.u32(next_sequence_);
  packet.u32(board_.now_us());
  packet.u32(highest_rate_mhz(plan_, timing_));
  board_.transmit(packet.finish());
}

void Device::send_identity(uint8_t tag) {
  const uint8_t name = text_length(name_);
  PacketWriter packet(board_.transmit_buffer(), kIdentity,
                      static_cast<uint16_t>(kIdentityBytes + name));
  packet.u8(tag);
  packet.u8(kProtocolVersion);
  for (uint8_t i = 0; i < 3; ++i) packet.u8(kVersion[i]);
  packet.u16(kAllContents);
  packet.u8(plan_.rows);
  packet.u8(plan_.cols);
  packet.u8(plan_.oversampling);
  packet.u8(kMaxSide);
  packet.u8(kMaxSide);
  packet.u8(kMaxOversampling);
  packet.u16(plan_.settle_us);
  packet.u16(kHeartbeatMs);
  packet.u8(static_cast<uint8_t>((reset_cause_ & 0x1F) | (streaming_ ? 0x80 : 0)));
  packet.u32(timing_.conversion_us);
  packet.u32(timing_.baud);
  packet.u32(plan_.rate_mhz);
  packet.u32(highest_rate_mhz(plan_, timing_));
  for (uint8_t i = 0; i < name; ++i) packet.u8(static_cast<uint8_t>(name_[i]));
  board_.transmit(packet.finish());
}

}  // namespace palpate
