#include "plan.h"

namespace palpate {

uint32_t highest_rate_mhz(const Plan& plan, const Timing& timing) {
  const uint32_t steps = plan.pixels();
  const uint32_t read_back = (plan.contents & kWithPressure) ? 1 : 0;
  const uint32_t conversions = steps * plan.oversampling + read_back;
  const uint32_t bytes = stuffed_bytes(frame_payload_bytes(plan.pixels(), plan.contents));

  const uint32_t scan_us = (steps + read_back) * (plan.settle_us + timing.per_step_us) +
                           conversions * timing.per_conversion_us;
  // A start and a stop bit per byte; 5 % of the link is reserved for answers.
  const uint32_t link_us = bytes * 105000u / (timing.baud / 100u);
  // 50 % more, for commands, load cells and the clock.
  const uint32_t busy_us = (conversions * timing.cpu_per_conversion_us +
                            bytes * timing.cpu_per_byte_us + timing.cpu_per_frame_us) * 3u / 2u;
  uint32_t period_us = scan_us;
  if (link_us > period_us) period_us = link_us;
  if (busy_us > period_us) period_us = busy_us;
  return 1000000000u / period_us;
}

}  // namespace palpate
