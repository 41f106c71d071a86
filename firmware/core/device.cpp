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
    case kServoTravel:
    case kServo:
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
  board_.set_servo_pulse(0);
  // The line stays low until a host sets a ceiling.
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
  if (result != kUnknownCommand) heard_us_ = board_.now_us();
  if (packet.type == kIdentify && result == kOk) {
    send_identity(packet.payload[0]);
  } else {
    send_ack(packet.type, packet.payload[0], result);
  }
}

Result Device::execute(const Packet& packet) {
  const uint8_t expected = argument_bytes(packet.type);
  if (expected == 0xFF) return kUnknownCommand;
  if (packet.type == kPressure && !(features_ & kWithPressure)) return kUnknownCommand;
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
      return set_pressure(u16_at(arguments), u32_at(arguments + 2));
    case kServoTravel:
      return set_servo_travel(u16_at(arguments), u16_at(arguments + 2));
    case kServo:
      return set_servo(u16_at(arguments), u16_at(arguments + 2));
    case kCeiling:
      if (u16_at(arguments) >= kAdcFullScale) return kBadArgument;
      ceiling_ = u16_at(arguments);
      tripped_ = false;
      armed_ = true;
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

Result Device::set_pressure(uint16_t target_pa, uint32_t slew_pa_per_s) {
  if (tripped_) return kTripped;
  if (target_pa > kMaxPressurePa || slew_pa_per_s < 1 || slew_pa_per_s > kMaxSlewPaPerS) {
    return kBadArgument;
  }
  pressure_.go(target_pa, slew_pa_per_s);
  heartbeat_lost_ = false;
  return kOk;
}

Result Device::set_servo_travel(uint16_t open_us, uint16_t closed_us) {
  const uint16_t low = open_us < closed_us ? open_us : closed_us;
  const uint16_t high = open_us < closed_us ? closed_us : open_us;
  if (low < kShortestPulseUs || high > kLongestPulseUs || low == high) return kBadArgument;
  const bool is_another = open_us != open_us_ || closed_us != closed_us_;
  if (is_another && servo_.value() != 0) return kBadArgument;
  open_us_ = open_us;
  closed_us_ = closed_us;
  return kOk;
}

bool Device::in_travel(uint16_t pulse_us) const {
  return open_us_ < closed_us_ ? open_us_ <= pulse_us && pulse_us <= closed_us_
                               : closed_us_ <= pulse_us && pulse_us <= open_us_;
}

// The first pulses after a reset or a trip are those of the open fingers, because the position of a
// hobby servo is unknown.
Result Device::set_servo(uint16_t target_us, uint16_t rate_us_per_s) {
  // Without supply, pulses would power the servo through its signal.
  if (tripped_ || !armed_) return kTripped;
  if (open_us_ == 0 || rate_us_per_s == 0) return kBadArgument;
  if (target_us != 0 && !in_travel(target_us)) return kBadArgument;
  if (target_us == 0) {
    servo_.hold();
  } else {
    if (servo_.value() == 0) servo_.jump(open_us_);
    servo_.go(target_us, rate_us_per_s);
  }
  heartbeat_lost_ = false;
  return kOk;
}

Result Device::start(uint8_t contents) {
  if (contents & ~features_) return kBadArgument;
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
  if (ceiling_ == 0 || tripped_) return;
  const uint16_t limit = static_cast<uint16_t>(ceiling_ * plan_.oversampling);
  for (uint16_t pixel = 0; pixel < plan_.pixels(); ++pixel) {
    if (scan.counts[pixel] < limit) continue;
    tripped_ = true;
    tripped_us_ = board_.now_us();
    pressure_.jump(0);
    board_.set_pressure_output(0);
    if (servo_.value() == 0) {
      board_.set_safe_line(false);
    } else {
      servo_.jump(open_us_);
    }
    return;
  }
}

void Device::poll() {
  const uint32_t now_us = board_.now_us();
  uint16_t elapsed_ms = 0;
  // A division would take 40 us.
  for (; now_us - polled_us_ >= 1000u && elapsed_ms < 1000u; ++elapsed_ms) polled_us_ += 1000u;
  if (elapsed_ms == 0) return;
  const bool driven = pressure_.target() != 0 || pressure_.value() != 0 || servo_.value() != 0;
  if (driven && now_us - heard_us_ > kHeartbeatMs * 1000ul) {
    pressure_.jump(0);
    servo_.hold();
    heartbeat_lost_ = true;
  }
  // The servo has had time to open; now its supply is cut with the safe line.
  if (tripped_ && servo_.value() != 0 && now_us - tripped_us_ > kBackOffMs * 1000ul) {
    servo_.jump(0);
    board_.set_safe_line(false);
  }
  pressure_.advance(elapsed_ms);
  servo_.advance(elapsed_ms);
  board_.set_pressure_output(pressure_.value());
  board_.set_servo_pulse(servo_.value());
}

uint8_t Device::status() const {
  uint8_t bits = 0;
  if (dropped_) bits |= kDropped;
  if (heartbeat_lost_) bits |= kHeartbeatLost;
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
    packet.u16(pressure_.value());
    packet.u16(static_cast<uint16_t>(static_cast<uint32_t>(scan.pressure_counts) *
                                     kMaxPressurePa / (kAdcFullScale - 1)));
  }
  if (plan_.contents & kWithServo) packet.u16(servo_.value());
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
  packet.u16(features_);
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
  packet.u16(kAdcFullScale);
  for (uint8_t i = 0; i < name; ++i) packet.u8(static_cast<uint8_t>(name_[i]));
  board_.transmit(packet.finish());
}

}  // namespace palpate
