#include "packet.h"

#ifdef __AVR__
#include <avr/pgmspace.h>
#else
#define PROGMEM
#define pgm_read_dword(address) (*(address))
#endif

namespace palpate {

namespace {

struct CrcTable {
  uint32_t of[256];
};

// In flash: with this kilobyte the link is several times faster than with a table of 16 entries.
constexpr CrcTable make_crc_table() {
  CrcTable table = {};
  for (uint16_t byte = 0; byte < 256; ++byte) {
    uint32_t crc = byte;
    for (uint8_t bit = 0; bit < 8; ++bit) crc = (crc & 1) ? 0xEDB88320u ^ (crc >> 1) : crc >> 1;
    table.of[byte] = crc;
  }
  return table;
}
constexpr CrcTable kCrc PROGMEM = make_crc_table();

}  // namespace

void Crc32::add(uint8_t byte) {
  state_ = pgm_read_dword(&kCrc.of[static_cast<uint8_t>(state_) ^ byte]) ^ (state_ >> 8);
}

PacketWriter::PacketWriter(uint8_t* out, uint8_t type, uint16_t payload) : out_(out) {
  u8(type);
  u16(payload);
}

void PacketWriter::stuff(uint8_t byte) {
  if (byte != 0) {
    out_[end_++] = byte;
    if (end_ - code_at_ < 0xFF) return;
  }
  out_[code_at_] = static_cast<uint8_t>(end_ - code_at_);
  code_at_ = end_++;
}

void PacketWriter::u8(uint8_t value) {
  crc_.add(value);
  stuff(value);
}

void PacketWriter::u16(uint16_t value) {
  u8(static_cast<uint8_t>(value));
  u8(static_cast<uint8_t>(value >> 8));
}

void PacketWriter::u32(uint32_t value) {
  u16(static_cast<uint16_t>(value));
  u16(static_cast<uint16_t>(value >> 16));
}

uint16_t PacketWriter::finish() {
  const uint32_t crc = crc_.value();
  for (uint8_t shift = 0; shift < 32; shift += 8) stuff(static_cast<uint8_t>(crc >> shift));
  out_[code_at_] = static_cast<uint8_t>(end_ - code_at_);
  out_[end_++] = 0;
  return end_;
}

PacketReader::Event PacketReader::feed(uint8_t byte) {
  if (byte != 0) {
    if (size_ < kMaxCommandBytes) {
      bytes_[size_++] = byte;
    } else {
      overlong_ = true;
    }
    return kNothing;
  }
  // Bytes before the first zero may be the end of a packet, so they are not reported as damaged.
  Event event = in_step_ ? kDamaged : kNothing;
  if (size_ == 0) {
    event = kNothing;
  } else if (!overlong_ && open()) {
    event = kPacket;
  }
  in_step_ = true;
  size_ = 0;
  overlong_ = false;
  return event;
}

bool PacketReader::open() {
  uint8_t at = 0;
  while (at < size_) {
    const uint8_t code = bytes_[at];
    bytes_[at] = 0;
    if (code > size_ - at) return false;
    at = static_cast<uint8_t>(at + code);
  }
  // The first code byte is not data.
  const uint8_t* body = bytes_ + 1;
  if (size_ < 1 + kHeadBytes + kCrcBytes) return false;
  const uint8_t payload = static_cast<uint8_t>(size_ - 1 - kHeadBytes - kCrcBytes);
  if (body[1] != payload || body[2] != 0) return false;
  Crc32 crc;
  const uint8_t* end = body + kHeadBytes + payload;
  for (const uint8_t* byte = body; byte != end; ++byte) crc.add(*byte);
  for (uint8_t i = 0; i < kCrcBytes; ++i) {
    if (end[i] != static_cast<uint8_t>(crc.value() >> (8 * i))) return false;
  }
  packet_ = {body[0], body + kHeadBytes, payload};
  return true;
}

}  // namespace palpate
