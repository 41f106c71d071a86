#include "regulator.h"

namespace palpate {

bool Regulator::set(uint32_t target_pa, uint32_t slew_pa_per_s) {
  if (target_pa > kMaxPressurePa || slew_pa_per_s < 1 || slew_pa_per_s > kMaxSlewPaPerS) {
    return false;
  }
  target_pa_ = target_pa;
  slew_pa_per_s_ = slew_pa_per_s;
  lost_ = false;
  return true;
}

void Regulator::vent() {
  target_pa_ = 0;
  output_mpa_ = 0;
}

uint16_t Regulator::update(uint32_t now_us) {
  if ((target_pa_ > 0 || output_mpa_ > 0) && now_us - heard_us_ > kHeartbeatMs * 1000ul) {
    vent();
    lost_ = true;
  }
  const uint32_t elapsed_ms = (now_us - updated_us_) / 1000u;
  if (elapsed_ms == 0) return output_pa();
  updated_us_ += elapsed_ms * 1000u;
  // Pa/s times ms is mPa; after a pause the step is bounded so that it can't overflow.
  const uint32_t step_mpa = slew_pa_per_s_ * (elapsed_ms < 1000u ? elapsed_ms : 1000u);
  const uint32_t target_mpa = target_pa_ * 1000u;
  if (target_mpa > output_mpa_) {
    output_mpa_ = target_mpa - output_mpa_ > step_mpa ? output_mpa_ + step_mpa : target_mpa;
  } else {
    output_mpa_ = output_mpa_ - target_mpa > step_mpa ? output_mpa_ - step_mpa : target_mpa;
  }
  return output_pa();
}

}  // namespace palpate
