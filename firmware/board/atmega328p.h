// Arduino Uno and Nano (ATmega328P): pins, and the timers used by avr.cpp.
#pragma once
#include "pins.h"

// Change a pin here: port letter and bit. The input of the converter is A0 (divider); the servo pin
// is fixed by its timer. Do not use pin 13, which the bootloader toggles. Rows as on the Mega:
// multiplexer or direct lines.
#define ROW_SELECT D, 2       // 2-3: row multiplexer select, low bit first
#define COLUMN_SELECT D, 4    // 4-5: column multiplexer select, low bit first
#define ROWS C, 2             // A2-A5: row lines 0-3 direct
#define SAFE_LINE B, 0        // 8: safe line
#define SERVO B, 2            // 10: servo signal (OC1B)
#define LOAD_CLOCK_0 D, 6     // 6: load cell 0 clock
#define LOAD_DATA_0 D, 7      // 7: load cell 0 data
#define LOAD_CLOCK_1 B, 3     // 11: load cell 1 clock
#define LOAD_DATA_1 B, 4      // 12: load cell 1 data

namespace board {

constexpr uint8_t kFeatures = palpate::kWithLoadCells | palpate::kWithServo;
// As on the Mega, but settling is counted in steps of 4 us.
constexpr palpate::Timing kTiming = {104, 120, 20, 8, 13, 80, BAUD};
constexpr uint8_t kGroundChannel = 0x0F;

inline void set_up_select_pins() {
  MAKE_OUTPUTS(ROW_SELECT, 2);
  MAKE_OUTPUTS(COLUMN_SELECT, 2);
  MAKE_OUTPUTS(ROWS, 4);
}

inline void select_pixel(uint8_t row, uint8_t col) {
  SET_PINS(ROW_SELECT, 2, row);
  SET_PINS(COLUMN_SELECT, 2, col);
  SET_PINS(ROWS, 4, static_cast<uint8_t>(1 << row));
}

// Timer 2 is the clock, at 16 MHz / 32. Timer 0 wakes the main loop and times the settling.
#define SERIAL_UDRE_vect USART_UDRE_vect
#define SERIAL_RX_vect USART_RX_vect
#define CLOCK_OVERFLOW_vect TIMER2_OVF_vect
#define SETTLED_vect TIMER0_COMPA_vect
constexpr uint8_t kOverflowShift = 9;  // an overflow every 2^9 us
inline uint16_t clock_part_us() { return static_cast<uint16_t>(TCNT2 << 1); }
inline bool overflow_waits() { return (TIFR2 & _BV(TOV2)) != 0; }

inline void start_settling(uint16_t settle_us) {
  // One more step, because the current step may be almost over.
  OCR0A = static_cast<uint8_t>(TCNT0 + (settle_us + 3) / 4 + 1);
  TIFR0 = _BV(OCF0A);
  TIMSK0 |= _BV(OCIE0A);
}
inline void stop_settling() { TIMSK0 &= static_cast<uint8_t>(~_BV(OCIE0A)); }

inline void set_up_timers() {
  TCCR2A = 0;
  TCCR2B = _BV(CS21) | _BV(CS20);
  TIMSK2 = _BV(TOIE2);
}

inline void set_pressure_output(uint16_t) {}

inline void clear_timer_flags() {}

}  // namespace board
