// C interface of the portable core for Python tests on the host.
#include <stddef.h>
#include <string.h>

#include "../core/device.h"

namespace {

using palpate::Device;
using palpate::LoadCell;
using palpate::Plan;
using palpate::Scan;

// A board without hardware, which stores its outputs and collects sent bytes.
class HostBoard final : public palpate::Board {
 public:
  uint32_t now_us() override { return now; }
  void start_scanning(const Plan&) override { scanning = true; }
  void stop_scanning() override { scanning = false; }
  uint8_t* transmit_buffer() override { return sent + size; }
  void transmit(uint16_t bytes) override { size += bytes; }
  void set_pressure_output(uint16_t pa) override { pressure_pa = pa; }
  void set_servo_pulse(uint16_t us) override { servo_us = us; }
  void set_safe_line(bool level) override { safe = level; }
  const LoadCell& load_cell(uint8_t index) override { return cells[index]; }

  uint32_t now = 0;
  uint8_t sent[8 * palpate::kMaxStuffedBytes];
  size_t size = 0;
  uint16_t pressure_pa = 0;
  uint16_t servo_us = 0;
  bool safe = false;
  bool scanning = false;
  LoadCell cells[palpate::kLoadCells];
};

struct Host {
  explicit Host(const palpate::Timing& timing) : device(board, timing, palpate::kAllContents, "host") {}
  HostBoard board;
  Device device;
};

}  // namespace

extern "C" {

Host* host_new(uint32_t baud) { return new Host({104, 120, 14, 8, 12, 80, baud}); }
void host_free(Host* host) { delete host; }
void host_begin(Host* host, uint8_t cause, uint8_t seed) { host->device.begin(cause, seed, false, false); }
void host_set_time(Host* host, uint32_t now_us) {
  host->board.now = now_us;
  host->device.poll();
}
void host_set_load(Host* host, uint8_t index, int32_t raw, uint8_t sample, uint8_t silent) {
  host->board.cells[index].raw = raw;
  host->board.cells[index].sample = sample;
  host->board.cells[index].silent = silent != 0;
}
void host_bytes(Host* host, const uint8_t* bytes, size_t size) {
  for (size_t i = 0; i < size; ++i) host->device.on_byte(bytes[i]);
}
void host_scan(Host* host, uint32_t sequence, uint32_t time_us, const uint16_t* counts,
               uint16_t pressure_counts) {
  host->device.on_scan(Scan{sequence, time_us, counts, pressure_counts});
}
// Moves the sent bytes to `out`; returns their number.
size_t host_take(Host* host, uint8_t* out) {
  const size_t size = host->board.size;
  memcpy(out, host->board.sent, size);
  host->board.size = 0;
  return size;
}
uint16_t host_pressure_pa(const Host* host) { return host->board.pressure_pa; }
uint16_t host_servo_us(const Host* host) { return host->board.servo_us; }
bool host_safe(const Host* host) { return host->board.safe; }
bool host_scanning(const Host* host) { return host->board.scanning; }

}  // extern "C"
