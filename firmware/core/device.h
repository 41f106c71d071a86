// Behaviour of the board: commands, streaming, safety. Board is the interface to the hardware.
#pragma once
#include <stdint.h>

#include "packet.h"
#include "plan.h"
#include "protocol.h"
#include "ramp.h"

namespace palpate {

struct LoadCell {
  int32_t raw = kNoReading;
  uint8_t sample = 0;
  bool silent = false;
};

// A completed scan of the board.
struct Scan {
  uint32_t sequence;
  uint32_t time_us;
  const uint16_t* counts;
  uint16_t pressure_counts;
};

// Interface of the hardware for the core.
class Board {
 public:
  virtual uint32_t now_us() = 0;
  virtual void start_scanning(const Plan& plan) = 0;
  virtual void stop_scanning() = 0;
  // A free transmit buffer of kMaxStuffedBytes, or null while both are being sent.
  virtual uint8_t* transmit_buffer() = 0;
  virtual void transmit(uint16_t size) = 0;
  virtual void set_pressure_output(uint16_t pa) = 0;
  // Width of the servo pulses; 0 for no pulses.
  virtual void set_servo_pulse(uint16_t us) = 0;
  virtual void set_safe_line(bool safe) = 0;
  virtual const LoadCell& load_cell(uint8_t index) = 0;

 protected:
  ~Board() = default;
};

class Device {
 public:
  // `features`: bits of `Contents` that the hardware has.
  Device(Board& board, const Timing& timing, uint8_t features, const char* name)
      : board_(board), timing_(timing), features_(features), name_(name) {}

  // `seed`: last stream number before the reset, so that new numbers differ. A trip of the ceiling
  // before the reset remains in force.
  void begin(uint8_t reset_cause, uint8_t seed, bool watchdog_since_power_up, bool tripped);
  // Call only while a transmit buffer is free: the byte may complete a command, which is answered.
  void on_byte(uint8_t byte);
  // Call only while a transmit buffer is free.
  void on_scan(const Scan& scan);
  void poll();
  // State to keep over a reset, for the next begin().
  uint8_t stream_seed() const { return stream_seed_; }
  bool tripped() const { return tripped_; }

 private:
  void obey(const Packet& packet);
  Result execute(const Packet& packet);
  Result start(uint8_t contents);
  Result set_layout(uint8_t rows, uint8_t cols, uint16_t settle_us);
  Result set_rate(uint32_t rate_mhz);
  Result set_pressure(uint16_t target_pa, uint32_t slew_pa_per_s);
  Result set_servo_travel(uint16_t open_us, uint16_t closed_us);
  Result set_servo(uint16_t target_us, uint16_t rate_us_per_s);
  bool in_travel(uint16_t pulse_us) const;
  void send_ack(uint8_t command, uint8_t tag, Result result);
  void send_identity(uint8_t tag);
  void send_frame(uint8_t* out, const Scan& scan);
  void check_ceiling(const Scan& scan);
  uint8_t status() const;

  Board& board_;
  Timing timing_;
  uint8_t features_;
  const char* name_;
  PacketReader reader_;
  Plan plan_;
  Ramp pressure_;
  // Pulses are sent while the value is not 0.
  Ramp servo_;
  uint16_t open_us_ = 0;
  uint16_t closed_us_ = 0;
  uint32_t polled_us_ = 0;
  uint32_t heard_us_ = 0;
  uint32_t tripped_us_ = 0;
  uint32_t next_sequence_ = 0;
  uint16_t ceiling_ = 0;
  uint8_t stream_ = 0;
  uint8_t stream_seed_ = 0;
  uint8_t reset_cause_ = 0;
  bool streaming_ = false;
  bool tripped_ = false;
  bool armed_ = false;
  bool watchdog_ = false;
  bool heartbeat_lost_ = false;
  bool dropped_ = false;
  bool damaged_ = false;
};

}  // namespace palpate
