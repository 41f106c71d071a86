// Arduino Mega 2560: pins, and the timers used by avr.cpp.
#pragma once
#include "pins.h"

#define BOARD_NAME "Arduino Mega 2560"

// Change a pin here: port letter and bit. The inputs of the converter are A0 (divider) and A1
// (pressure read-back); the servo and pressure pins are fixed by their timers. Do not use pin 13,
// which the bootloader toggles. Rows are connected either to the row multiplexer (idle rows float)
// or to the direct lines (idle rows are grounded, the selected row is high); both sets of pins are
// always driven.
#define ROW_SELECT L, 0       // 49-46: row multiplexer select, low bit first
#define COLUMN_SELECT L, 4    // 45-42: column multiplexer select, low bit first
#define ROWS_LOW A, 0         // 22-29: row lines 0-7 direct
#define ROWS_HIGH C, 0        // 37-30: row lines 8-15 direct
#define SAFE_LINE H, 5        // 8: safe line
#define SERVO B, 6            // 12: servo signal (OC1B)
#define PRESSURE E, 3         // 5: pressure output (OC3A)
#define LOAD_CLOCK_0 G, 0     // 41: load cell 0 clock
#define LOAD_DATA_0 J, 1      // 14: load cell 0 data
#define LOAD_CLOCK_1 G, 2     // 39: load cell 1 clock
#define LOAD_DATA_1 D, 7      // 38: load cell 1 data

namespace board {

constexpr uint8_t kFeatures =
    palpate::kWithLoadCells | palpate::kWithPressure | palpate::kWithServo;
// Conversion: 13 ADC clocks, up to one clock until the edge of the ADC clock, and the interrupt.
// Measured in the simulator and rounded up.
constexpr palpate::Timing kTiming = {104, 120, 14, 8, 12, 80, BAUD};
constexpr uint8_t kGroundChannel = 0x1F;

inline void set_up_select_pins() {
  MAKE_OUTPUTS(ROW_SELECT, 4);
  MAKE_OUTPUTS(COLUMN_SELECT, 4);
  MAKE_OUTPUTS(ROWS_LOW, 8);
  MAKE_OUTPUTS(ROWS_HIGH, 8);
}

inline void select_pixel(uint8_t row, uint8_t col) {
  SET_PINS(ROW_SELECT, 4, row);
  SET_PINS(COLUMN_SELECT, 4, col);
  SET_PINS(ROWS_LOW, 8, row < 8 ? static_cast<uint8_t>(1 << row) : 0);
  SET_PINS(ROWS_HIGH, 8, row < 8 ? 0 : static_cast<uint8_t>(1 << (row - 8)));
}

// Timer 5 is the clock and timer 4 times the settling, both at 16 MHz / 8. They are separate, so
// that no compare register is written on the timer whose overflows are counted.
#define SERIAL_UDRE_vect USART0_UDRE_vect
#define SERIAL_RX_vect USART0_RX_vect
#define CLOCK_OVERFLOW_vect TIMER5_OVF_vect
#define SETTLED_vect TIMER4_COMPA_vect
constexpr uint8_t kOverflowShift = 15;  // an overflow every 2^15 us
inline uint16_t clock_part_us() { return TCNT5 >> 1; }
inline bool overflow_waits() { return (TIFR5 & _BV(TOV5)) != 0; }

inline void start_settling(uint16_t settle_us) {
  OCR4A = static_cast<uint16_t>(TCNT4 + 2 * settle_us);
  TIFR4 = _BV(OCF4A);
  TIMSK4 = _BV(OCIE4A);
}
inline void stop_settling() { TIMSK4 = 0; }

constexpr uint16_t kPwmTop = 1023;  // timer 3 at 16 MHz / 1024: 15.6 kHz

inline void set_up_timers() {
  TCCR4A = 0;
  TCCR4B = _BV(CS41);
  TCCR5A = 0;
  TCCR5B = _BV(CS51);
  TIMSK5 = _BV(TOIE5);
  ICR3 = kPwmTop;
  TCCR3A = _BV(WGM31);
  TCCR3B = _BV(WGM33) | _BV(WGM32) | _BV(CS30);
  MAKE_OUTPUTS(PRESSURE, 1);
}

inline void set_pressure_output(uint16_t pa) {
  const uint16_t duty =
      static_cast<uint16_t>(static_cast<uint32_t>(pa) * kPwmTop / palpate::kMaxPressurePa);
  // A compare value of 0 still produces a pulse of one clock, so for zero the pin is held low.
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
    OCR3A = duty;
    TCCR3A = static_cast<uint8_t>((duty ? _BV(COM3A1) : 0) | _BV(WGM31));
  }
}

inline void clear_timer_flags() { TIFR3 = TIFR4 = TIFR5 = 0xFF; }

}  // namespace board
