// Settings of the board, and the highest possible frame rate.
#pragma once
#include <stdint.h>

#include "protocol.h"

namespace palpate {

// Times of the hardware, microseconds.
struct Timing {
  uint16_t conversion_us;       // nominal, one ADC conversion
  uint16_t per_conversion_us;   // conversion, wait for the ADC clock, interrupt
  uint16_t per_step_us;         // switching a multiplexer, in addition to the settle time
  uint16_t cpu_per_conversion_us;
  uint16_t cpu_per_byte_us;     // encoding and sending
  uint16_t cpu_per_frame_us;
  uint32_t baud;
};

struct Plan {
  uint8_t rows = 4;
  uint8_t cols = 2;
  uint16_t settle_us = 20;
  uint8_t oversampling = 1;
  uint8_t contents = 0;
  uint32_t rate_mhz = 100000;

  uint16_t pixels() const { return static_cast<uint16_t>(rows * cols); }
};

// Highest rate that scan, link and processor support, millihertz.
uint32_t highest_rate_mhz(const Plan& plan, const Timing& timing);

}  // namespace palpate
