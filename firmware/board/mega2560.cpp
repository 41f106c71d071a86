// Arduino Mega 2560: pins, timers, converter and serial port under the portable core.
//
// Wiring (Mega pin: port bit):
//   A0 ADC0  divider              49-46 PL0-3  row multiplexer select, low bit first
//   A1 ADC1  pressure read-back   45-42 PL4-7  column multiplexer select, low bit first
//   5  PE3   pressure output      22-29 PA0-7  row lines 0-7 direct: selected high, idle grounded
//   8  PH5   safe line            37-30 PC0-7  row lines 8-15 direct, likewise
//   41 PG0, 14 PJ1  load cell 0 clock, data      39 PG2, 38 PD7  load cell 1 clock, data
// Rows go either to the row multiplexer (idle rows float) or to the direct lines (idle rows are
// grounded); both sets of pins are always driven.
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
#include <avr/wdt.h>
#include <util/atomic.h>
#include <util/delay.h>

#include "../core/device.h"

namespace {

using palpate::LoadCell;
using palpate::Plan;
using palpate::Scan;

// 16 MHz / 128 = 125 kHz: inside the 50-200 kHz that the data sheet asks for full 10-bit accuracy
// (section 26.4). A prescaler of 16 would be eight times faster and lose about 1 LSB.
constexpr uint8_t kAdcSilent = _BV(ADEN) | _BV(ADPS2) | _BV(ADPS1) | _BV(ADPS0);
constexpr uint8_t kAdcEnable = kAdcSilent | _BV(ADIE);
constexpr uint8_t kAdcSupplyReference = _BV(REFS0);
constexpr uint8_t kReadBackChannel = 1;
constexpr uint8_t kGroundChannel = 0x1F;

// Timer 1 gives the frames, timer 4 the settle time, timer 5 the clock, all at 16 MHz / 8. One each:
// a compare register is never written on the timer whose overflows are counted.
constexpr uint32_t kTicksPerSecond = 2000000;
constexpr uint16_t kPwmTop = 1023;  // timer 3 at 16 MHz / 1024: 15.6 kHz
constexpr uint32_t kSilentUs = 500000;         // five readings of an HX711 at its slower rate

constexpr uint16_t kDivisor = static_cast<uint16_t>((F_CPU + BAUD * 4) / (BAUD * 8) - 1);

// Conversion: 13 ADC clocks, up to one of waiting for the ADC clock's edge, and the interrupt.
// Measured in the simulator and rounded up.
constexpr palpate::Timing kTiming = {104, 120, 14, 8, 12, 80, BAUD};

// Survives resets: the number of the last stream, whether the watchdog ever bit, and a trip of the
// ceiling.
struct Kept {
  uint16_t magic;
  uint8_t stream_seed;
  bool watchdog;
  bool tripped;
};
constexpr uint16_t kMagic = 0x9A17;
Kept kept __attribute__((section(".noinit")));
uint8_t reset_cause __attribute__((section(".noinit")));

struct Scanner {
  Plan plan;
  bool active;
  uint8_t row, col, conversions_left;
  bool reading_back;
  uint16_t sum, pixel;
  uint32_t next_sequence, sequence, time_us;
  uint32_t ticks_left, period_ticks, period_rest, rest_sum;
  // One is filled by the interrupts while the other waits to be sent.
  uint16_t counts[2][palpate::kMaxPixels];
  uint16_t pressure[2];
  uint8_t filling;
  Scan done;
  volatile bool ready;
};
Scanner scanner;

struct Transmitter {
  uint8_t bytes[2][palpate::kMaxStuffedBytes];
  volatile uint16_t size[2];  // 0: free
  uint8_t sending, filling;
  uint16_t at;
};
Transmitter transmitter;

struct Receiver {
  uint8_t bytes[64];
  volatile uint8_t head, tail;
};
Receiver receiver;

volatile uint32_t overflows;

// Keeps the compiler from reading what an interrupt wrote before the flag that says so.
inline void after_flag() { __asm__ volatile("" ::: "memory"); }

LoadCell load_cells[palpate::kLoadCells];
uint32_t load_read_us[palpate::kLoadCells];

// Interrupts must be off.
uint32_t clock_us() {
  const uint16_t ticks = TCNT5;
  uint32_t high = overflows;
  if ((TIFR5 & _BV(TOV5)) && ticks < 0x8000) ++high;
  return high << 15 | ticks >> 1;
}

inline void select_pixel(uint8_t row, uint8_t col) {
  PORTL = static_cast<uint8_t>(row | col << 4);
  PORTA = row < 8 ? static_cast<uint8_t>(1 << row) : 0;
  PORTC = row < 8 ? 0 : static_cast<uint8_t>(1 << (row - 8));
}

inline void convert_after_settling() {
  OCR4A = static_cast<uint16_t>(TCNT4 + 2 * scanner.plan.settle_us);
  TIFR4 = _BV(OCF4A);
  TIMSK4 = _BV(OCIE4A);
}

inline void begin_pixel() {
  select_pixel(scanner.row, scanner.col);
  scanner.sum = 0;
  scanner.conversions_left = scanner.plan.oversampling;
  convert_after_settling();
}

void begin_scan() {
  const uint32_t sequence = scanner.next_sequence++;
  // The plan keeps scans shorter than the period; should one ever not be, its successor is
  // dropped, and the numbering tells so.
  if (scanner.active) return;
  scanner.active = true;
  scanner.sequence = sequence;
  scanner.time_us = clock_us();
  scanner.row = scanner.col = 0;
  scanner.pixel = 0;
  scanner.reading_back = false;
  begin_pixel();
}

void end_scan() {
  scanner.active = false;
  // The scan before is still waiting for the line: drop this one.
  if (scanner.ready) return;
  scanner.done.sequence = scanner.sequence;
  scanner.done.time_us = scanner.time_us;
  scanner.done.counts = scanner.counts[scanner.filling];
  scanner.done.pressure_counts = scanner.pressure[scanner.filling];
  scanner.filling ^= 1;
  scanner.ready = true;
}

// After the last conversion of a pixel: on to the next one, the read-back or the end.
void end_pixel() {
  if (scanner.reading_back) {
    scanner.pressure[scanner.filling] = scanner.sum;
    ADMUX = kAdcSupplyReference;
    end_scan();
    return;
  }
  scanner.counts[scanner.filling][scanner.pixel++] = scanner.sum;
  if (++scanner.col == scanner.plan.cols) {
    scanner.col = 0;
    ++scanner.row;
  }
  if (scanner.row < scanner.plan.rows) {
    begin_pixel();
  } else if (scanner.plan.contents & palpate::kWithPressure) {
    scanner.reading_back = true;
    ADMUX = kAdcSupplyReference | kReadBackChannel;
    scanner.sum = 0;
    scanner.conversions_left = 1;
    convert_after_settling();
  } else {
    end_scan();
  }
}

// A compare reaches 65535 ticks; longer periods are counted down in pieces.
void schedule_frame() {
  if (scanner.ticks_left == 0) {
    scanner.ticks_left = scanner.period_ticks;
    scanner.rest_sum += scanner.period_rest;
    if (scanner.rest_sum >= scanner.plan.rate_mhz) {
      scanner.rest_sum -= scanner.plan.rate_mhz;
      ++scanner.ticks_left;
    }
  }
  const uint32_t left = scanner.ticks_left;
  const uint16_t step = left > 0xC000 ? 0x8000 : static_cast<uint16_t>(left);
  OCR1A = static_cast<uint16_t>(OCR1A + step);
  scanner.ticks_left = left - step;
}

class Mega final : public palpate::Board {
 public:
  uint32_t now_us() override {
    uint32_t now;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { now = clock_us(); }
    return now;
  }

  void start_scanning(const Plan& plan) override {
    stop_scanning();
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
      scanner.plan = plan;
      scanner.next_sequence = 0;
      scanner.period_ticks = kTicksPerSecond * 1000 / plan.rate_mhz;
      scanner.period_rest = kTicksPerSecond * 1000 % plan.rate_mhz;
      scanner.rest_sum = 0;
      scanner.ticks_left = 0;
      OCR1A = TCNT1;
      schedule_frame();
      TIFR1 = _BV(OCF1A);
      TIMSK1 = _BV(OCIE1A);
    }
  }

  void stop_scanning() override {
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
      TIMSK1 = 0;
      TIMSK4 = 0;
      ADCSRA = kAdcSilent;
      scanner.active = false;
      scanner.ready = false;
    }
    // A conversion under way ends by itself. Switched off and on, the converter would take 25 clocks
    // for the next one to initialize itself (section 26.4).
    while (ADCSRA & _BV(ADSC)) {
    }
    ADCSRA = kAdcEnable | _BV(ADIF);
    ADMUX = kAdcSupplyReference;
  }

  uint8_t* transmit_buffer() override {
    const uint8_t filling = transmitter.filling;
    return transmitter.size[filling] == 0 ? transmitter.bytes[filling] : nullptr;
  }

  void transmit(uint16_t size) override {
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
      transmitter.size[transmitter.filling] = size;
      transmitter.filling ^= 1;
      UCSR0B |= _BV(UDRIE0);
    }
  }

  void set_pressure_output(uint16_t pa) override {
    if (pa == output_pa_) return;
    output_pa_ = pa;
    const uint16_t duty = static_cast<uint16_t>(static_cast<uint32_t>(pa) * kPwmTop /
                                                palpate::kMaxPressurePa);
    // A compare of 0 still gives a pulse of one clock: zero means the pin itself is held low.
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
      OCR3A = duty;
      TCCR3A = static_cast<uint8_t>((duty ? _BV(COM3A1) : 0) | _BV(WGM31));
    }
  }

  void set_safe_line(bool safe) override {
    // Out of the reach of sbi and cbi, and no interrupt writes this port. Not pin 13, which the boot
    // loader blinks.
    if (safe) {
      PORTH |= _BV(PH5);
    } else {
      PORTH &= static_cast<uint8_t>(~_BV(PH5));
    }
  }

  const LoadCell& load_cell(uint8_t index) override { return load_cells[index]; }

 private:
  uint16_t output_pa_ = 0;
};

Mega mega;
palpate::Device device(mega, kTiming, "Arduino Mega 2560");

bool load_ready(uint8_t index) {
  return index == 0 ? !(PINJ & _BV(PJ1)) : !(PIND & _BV(PD7));
}

// HX711 data sheet, "Serial Interface": 24 bits, then one pulse for channel A at gain 128. A clock
// held high for 60 us would put it to sleep, so no interrupt may fall into a pulse.
void read_load_cell(uint8_t index) {
  const uint8_t clock = index == 0 ? _BV(PG0) : _BV(PG2);
  uint32_t bits = 0;
  for (uint8_t i = 0; i < 25; ++i) {
    uint8_t level;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
      PORTG |= clock;
      _delay_us(1);
      level = load_ready(index) ? 0 : 1;
      PORTG &= static_cast<uint8_t>(~clock);
    }
    _delay_us(1);
    if (i < 24) bits = bits << 1 | level;
  }
  if (bits & 0x800000) bits |= 0xFF000000;
  load_cells[index].raw = static_cast<int32_t>(bits);
  ++load_cells[index].sample;
}

void poll_load_cells() {
  const uint32_t now = mega.now_us();
  for (uint8_t i = 0; i < palpate::kLoadCells; ++i) {
    if (load_ready(i)) {
      read_load_cell(i);
      load_read_us[i] = now;
      load_cells[i].silent = false;
    } else if (now - load_read_us[i] > kSilentUs) {
      // Stays so when the clock wraps, after 71 minutes.
      load_cells[i].silent = true;
    }
  }
}

void set_up_pins() {
  DDRL = 0xFF;
  DDRA = 0xFF;
  DDRC = 0xFF;
  DDRE |= _BV(PE3);
  DDRH |= _BV(PH5);
  DDRG |= _BV(PG0) | _BV(PG2);
  // Pulled up, so that an absent load cell reads as never ready.
  PORTJ |= _BV(PJ1);
  PORTD |= _BV(PD7);
}

void set_up_converter() {
  // The digital inputs of the two analog pins draw current at half the supply (section 26.8.6).
  DIDR0 = _BV(ADC0D) | _BV(ADC1D);
  // The first conversion, which initializes the converter, is of ground.
  ADMUX = kAdcSupplyReference | kGroundChannel;
  ADCSRA = kAdcSilent | _BV(ADSC);
}

void set_up_timers() {
  TCCR1A = 0;
  TCCR1B = _BV(CS11);
  TCCR4A = 0;
  TCCR4B = _BV(CS41);
  TCCR5A = 0;
  TCCR5B = _BV(CS51);
  TIMSK5 = _BV(TOIE5);
  // Timer 0 wakes the main loop every 1.024 ms, for slew limit, heartbeat and watchdog.
  TCCR0B = _BV(CS01) | _BV(CS00);
  TIMSK0 = _BV(TOIE0);
  ICR3 = kPwmTop;
  TCCR3A = _BV(WGM31);
  TCCR3B = _BV(WGM33) | _BV(WGM32) | _BV(CS30);
}

void set_up_serial() {
  UCSR0A = _BV(U2X0);
  UBRR0 = kDivisor;
  UCSR0C = _BV(UCSZ01) | _BV(UCSZ00);
  UCSR0B = _BV(RXEN0) | _BV(TXEN0) | _BV(RXCIE0);
  // Cuts off whatever the reset left on the line.
  UDR0 = 0;
}

void remember_reset() {
  if (kept.magic != kMagic || (reset_cause & _BV(PORF))) kept = {kMagic, 0, false, false};
  if (reset_cause & _BV(WDRF)) kept.watchdog = true;
}

}  // namespace

// The watchdog stays on after its own reset, with its shortest time: it must go before main.
void first_thing() __attribute__((naked, used, section(".init3")));
void first_thing() {
  reset_cause = MCUSR;
  MCUSR = 0;
  wdt_disable();
}

EMPTY_INTERRUPT(TIMER0_OVF_vect)

ISR(TIMER5_OVF_vect) { ++overflows; }

ISR(TIMER1_COMPA_vect) {
  const bool due = scanner.ticks_left == 0;
  schedule_frame();
  if (due) begin_scan();
}

ISR(TIMER4_COMPA_vect) {
  TIMSK4 = 0;
  ADCSRA |= _BV(ADSC);
}

ISR(ADC_vect) {
  scanner.sum = static_cast<uint16_t>(scanner.sum + ADC);
  if (--scanner.conversions_left != 0) {
    ADCSRA |= _BV(ADSC);
  } else {
    end_pixel();
  }
}

ISR(USART0_UDRE_vect) {
  const uint8_t sending = transmitter.sending;
  UDR0 = transmitter.bytes[sending][transmitter.at++];
  if (transmitter.at != transmitter.size[sending]) return;
  transmitter.at = 0;
  transmitter.size[sending] = 0;
  transmitter.sending = sending ^ 1;
  if (transmitter.size[sending ^ 1] == 0) UCSR0B &= static_cast<uint8_t>(~_BV(UDRIE0));
}

ISR(USART0_RX_vect) {
  const uint8_t byte = UDR0;
  const uint8_t next = (receiver.head + 1) & (sizeof receiver.bytes - 1);
  // When full, the byte is lost, and with it by its CRC the command.
  if (next == receiver.tail) return;
  receiver.bytes[receiver.head] = byte;
  receiver.head = next;
}

namespace {

bool byte_waits() { return receiver.tail != receiver.head && mega.transmit_buffer() != nullptr; }
bool scan_waits() { return scanner.ready && mega.transmit_buffer() != nullptr; }

void take_byte() {
  after_flag();
  const uint8_t byte = receiver.bytes[receiver.tail];
  receiver.tail = (receiver.tail + 1) & (sizeof receiver.bytes - 1);
  device.on_byte(byte);
  kept.stream_seed = device.stream_seed();
  kept.tripped = device.tripped();
}

void take_scan() {
  after_flag();
  device.on_scan(scanner.done);
  kept.tripped = device.tripped();
  after_flag();
  scanner.ready = false;
}

// Until the next interrupt; nothing can slip in between the look and the sleep. A sleeping
// processor also disturbs the converter less.
void rest() {
  cli();
  if (!byte_waits() && !scan_waits()) {
    sleep_enable();
    sei();
    sleep_cpu();
    sleep_disable();
  }
  sei();
}

}  // namespace

int main() {
  remember_reset();
  set_up_pins();
  set_up_timers();
  set_up_serial();
  set_up_converter();
  mega.stop_scanning();
  set_sleep_mode(SLEEP_MODE_IDLE);
  wdt_enable(WDTO_250MS);
  sei();
  device.begin(reset_cause, kept.stream_seed, kept.watchdog, kept.tripped);
  for (;;) {
    wdt_reset();
    if (byte_waits()) take_byte();
    if (scan_waits()) take_scan();
    poll_load_cells();
    device.poll();
    rest();
  }
}
