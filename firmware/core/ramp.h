// A quantity with a limited rate of change: pressure of the regulator, pulse width of the servo.
#pragma once
#include <stdint.h>

namespace palpate {

class Ramp {
 public:
  void go(uint16_t target, uint32_t rate_per_s) {
    target_ = target;
    rate_per_s_ = rate_per_s;
  }
  // Sets value and target immediately.
  void jump(uint16_t value) {
    target_ = value_ = value;
    milli_ = value * 1000ul;
  }
  // Stops at the current value.
  void hold() { target_ = value_; }
  // Advances by at most one second.
  void advance(uint16_t ms) {
    const uint32_t target = target_ * 1000ul;
    if (milli_ == target) return;
    const uint32_t step = rate_per_s_ * ms;
    if (target > milli_) {
      milli_ = target - milli_ > step ? milli_ + step : target;
    } else {
      milli_ = milli_ - target > step ? milli_ - step : target;
    }
    value_ = static_cast<uint16_t>(milli_ / 1000u);
  }

  uint16_t target() const { return target_; }
  uint16_t value() const { return value_; }

 private:
  uint16_t target_ = 0;
  uint16_t value_ = 0;
  uint32_t rate_per_s_ = 1;
  // In thousandths, so that slow rates are not rounded to zero between updates.
  uint32_t milli_ = 0;
};

}  // namespace palpate
