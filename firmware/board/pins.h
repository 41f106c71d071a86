// A pin is "port letter, bit", as in the tables of the board files; macros that access pins.
#pragma once
#include <avr/io.h>
#include <stdint.h>
#include <util/atomic.h>

#define PALPATE_JOIN(head, tail) head##tail
#define PALPATE_PORT(port, bit) PALPATE_JOIN(PORT, port)
#define PALPATE_DDR(port, bit) PALPATE_JOIN(DDR, port)
#define PALPATE_PIN(port, bit) PALPATE_JOIN(PIN, port)
#define PALPATE_BIT(port, bit) bit
// The argument `pin` is a name in a table.
#define PORT_OF(...) PALPATE_PORT(__VA_ARGS__)
#define BIT_OF(...) PALPATE_BIT(__VA_ARGS__)
#define IS_HIGH(pin) ((PALPATE_PIN(pin) >> BIT_OF(pin) & 1) != 0)
#define MAKE_OUTPUTS(pin, width) (PALPATE_DDR(pin) |= ((1 << (width)) - 1) << BIT_OF(pin))
#define SET_PIN(pin, is_high) palpate_set_field<BIT_OF(pin), 1>(PORT_OF(pin), is_high)
// Sets `width` pins of a port, starting at `pin`, low bit first.
#define SET_PINS(pin, width, value) palpate_set_field<BIT_OF(pin), width>(PORT_OF(pin), value)

template <uint8_t first, uint8_t width>
inline void palpate_set_field(volatile uint8_t& port, uint8_t value) {
  constexpr uint8_t mask = static_cast<uint8_t>(((1 << width) - 1) << first);
  // Interrupts write other bits of the same port.
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
    port = static_cast<uint8_t>((port & ~mask) | (value << first));
  }
}
