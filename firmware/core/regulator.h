// The pressure output: slew limit, heartbeat, trip. Time in microseconds, pressure in pascal.
#pragma once
#include <stdint.h>

#include "protocol.h"

namespace palpate {

class Regulator {
 public:
  // Sets target and slew; false if out of range.
  bool set(uint32_t target_pa, uint32_t slew_pa_per_s);
  // Any valid command.
  void heartbeat(uint32_t now_us) { heard_us_ = now_us; }
  // Goes to zero at once.
  void vent();
  // Call often; returns the output now.
  uint16_t update(uint32_t now_us);

  uint16_t output_pa() const { return static_cast<uint16_t>(output_mpa_ / 1000u); }
  bool heartbeat_lost() const { return lost_; }

 private:
  uint32_t target_pa_ = 0;
  uint32_t slew_pa_per_s_ = 1;
  // In millipascal, so that slow slews do not round away between two updates.
  uint32_t output_mpa_ = 0;
  uint32_t updated_us_ = 0;
  uint32_t heard_us_ = 0;
  bool lost_ = false;
};

}  // namespace palpate
