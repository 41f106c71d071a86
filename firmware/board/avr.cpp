// An Arduino with an AVR: converter, frames, servo and serial port for the portable core.
// BOARD is the file with the pins and timers.
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
#include <avr/wdt.h>
#include <util/delay.h>

#include "../core/device.h"
#include BOARD

namespace {

using palpate::LoadCell;
using palpate::Plan;
using palpate::Scan;

// 16 MHz / 128 = 125 kHz, within the 50-200 kHz of the data sheet for full 10-bit accuracy (section
// 26.4). A prescaler of 16 would be eight times faster and lose about 1 LSB.
constexpr uint8_t kAdcSilent = _BV(ADEN) | _BV(ADPS2) | _BV(ADPS1) | _BV(ADPS0);
constexpr uint8_t kAdcEnable = kAdcSilent | _BV(ADIE);
constexpr uint8_t kAdcSupplyReference = _BV(REFS0);
constexpr uint8_t kReadBackChannel = 1;

// Timer 1 at 16 MHz / 8 times the frames (compare A) and the servo pulses (compare B).
constexpr uint32_t kTicksPerSecond = 2000000;
constexpr uint16_t kServoPeriodTicks = 40000;  // 20 ms
constexpr uint32_t kSilentUs = 500000;         // five readings of an HX711 at its slower rate

constexpr uint16_t kDivisor = static_cast<uint16_t>((F_CPU + BAUD * 4) / (BAUD * 8) - 1);

// State that survives resets: number of the last stream, whether the watchdog has reset the board,
// a trip of the ceiling, and the time since the watchdog was last served. The last replaces the
// reset cause, which bootloaders clear.
struct Kept {
  uint16_t magic;
  volatile uint8_t unfed_ticks;  // of 1.024 ms
  uint8_t stream_seed;
  bool watchdog;
  bool tripped;
};
constexpr uint16_t kMagic = 0x9A18;
// The watchdog times out after 250 ms on its own oscillator, which may be about 10 % fast. The main
// loop takes less than 20 ms.
constexpr uint8_t kHungTicks = 190;
// Data addresses of the first register, and of the registers that the start-up code sets.
constexpr uint16_t kFirstRegister = 0x20, kStackLow = 0x5D, kStackHigh = 0x5E, kStatus = 0x5F;
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
  // One buffer is filled by the interrupts while the other waits for transmission.
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

struct Servo {
  uint16_t ticks;        // requested pulse width; 0: no pulses
  uint16_t pulse_ticks;  // width of the latest pulse
  bool is_high;
};
Servo servo;

volatile uint32_t overflows;
volatile bool ticked;

// Prevents the compiler from reading interrupt data before the flag that announces the data.
inline void after_flag() { __asm__ volatile("" ::: "memory"); }

LoadCell load_cells[palpate::kLoadCells];
uint32_t load_read_us[palpate::kLoadCells];

// Interrupts must be off.
uint32_t clock_us() {
  const uint16_t part_us = board::clock_part_us();
  uint32_t high = overflows;
  if (board::overflow_waits() && part_us < 1u << (board::kOverflowShift - 1)) ++high;
  return high << board::kOverflowShift | part_us;
}

inline void begin_pixel() {
  board::select_pixel(scanner.row, scanner.col);
  scanner.sum = 0;
  scanner.conversions_left = scanner.plan.oversampling;
  board::start_settling(scanner.plan.settle_us);
}

void begin_scan() {
  const uint32_t sequence = scanner.next_sequence++;
  // The plan keeps scans shorter than the period. If a scan is longer, the next scan is dropped and
  // its number is skipped.
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
  // The previous scan still waits for transmission: drop this scan.
  if (scanner.ready) return;
  scanner.done.sequence = scanner.sequence;
  scanner.done.time_us = scanner.time_us;
  scanner.done.counts = scanner.counts[scanner.filling];
  scanner.done.pressure_counts = scanner.pressure[scanner.filling];
  scanner.filling ^= 1;
  scanner.ready = true;
}

// After the last conversion of a pixel: start the next pixel or the read-back, or end the scan.
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
    board::start_settling(scanner.plan.settle_us);
  } else {
    end_scan();
  }
}

// A compare register holds up to 65535 ticks; longer periods are divided into steps.
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

class Arduino final : public palpate::Board {
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
      TIMSK1 |= _BV(OCIE1A);
    }
  }

  void stop_scanning() override {
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
      TIMSK1 &= static_cast<uint8_t>(~_BV(OCIE1A));
      board::stop_settling();
      ADCSRA = kAdcSilent;
      scanner.active = false;
      scanner.ready = false;
    }
    // Wait for the current conversion. After switching the converter off and on, the next
    // conversion would take 25 clocks (section 26.4).
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
    board::set_pressure_output(pa);
  }

  void set_servo_pulse(uint16_t us) override {
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
      servo.ticks = static_cast<uint16_t>(2 * us);
      if (us != 0 && !(TIMSK1 & _BV(OCIE1B))) {
        servo.is_high = false;
        OCR1B = static_cast<uint16_t>(TCNT1 + kServoPeriodTicks / 2);
        TCCR1A = _BV(COM1B1) | _BV(COM1B0);
        TIFR1 = _BV(OCF1B);
        TIMSK1 |= _BV(OCIE1B);
      }
    }
  }

  void set_safe_line(bool safe) override { SET_PIN(SAFE_LINE, safe); }

  const LoadCell& load_cell(uint8_t index) override { return load_cells[index]; }

 private:
  uint16_t output_pa_ = 0;
};

Arduino arduino;
palpate::Device device(arduino, board::kTiming, board::kFeatures, BOARD_NAME);

bool load_ready(uint8_t index) {
  return index == 0 ? !IS_HIGH(LOAD_DATA_0) : !IS_HIGH(LOAD_DATA_1);
}

void set_load_clock(uint8_t index, bool is_high) {
  if (index == 0) {
    SET_PIN(LOAD_CLOCK_0, is_high);
  } else {
    SET_PIN(LOAD_CLOCK_1, is_high);
  }
}

// HX711 data sheet, "Serial Interface": 24 bits, then one pulse for channel A at gain 128. A clock
// pulse of 60 us would power the HX711 down, so interrupts are off during a pulse.
void read_load_cell(uint8_t index) {
  uint32_t bits = 0;
  for (uint8_t i = 0; i < 25; ++i) {
    uint8_t level;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
      set_load_clock(index, true);
      _delay_us(1);
      level = load_ready(index) ? 0 : 1;
      set_load_clock(index, false);
    }
    _delay_us(1);
    if (i < 24) bits = bits << 1 | level;
  }
  if (bits & 0x800000) bits |= 0xFF000000;
  load_cells[index].raw = static_cast<int32_t>(bits);
  ++load_cells[index].sample;
}

void poll_load_cells() {
  const uint32_t now = arduino.now_us();
  for (uint8_t i = 0; i < palpate::kLoadCells; ++i) {
    if (load_ready(i)) {
      read_load_cell(i);
      load_read_us[i] = now;
      load_cells[i].silent = false;
    } else if (now - load_read_us[i] > kSilentUs) {
      // The flag stays set when the clock wraps after 71 minutes.
      load_cells[i].silent = true;
    }
  }
}

void set_up_pins() {
  board::set_up_select_pins();
  MAKE_OUTPUTS(SAFE_LINE, 1);
  MAKE_OUTPUTS(SERVO, 1);
  MAKE_OUTPUTS(LOAD_CLOCK_0, 1);
  MAKE_OUTPUTS(LOAD_CLOCK_1, 1);
  // Pulled up, so that an absent load cell reads as never ready.
  SET_PIN(LOAD_DATA_0, true);
  SET_PIN(LOAD_DATA_1, true);
}

void set_up_converter() {
  // The digital inputs of the two analog pins draw current at half the supply (section 26.8.6).
  DIDR0 = _BV(ADC0D) | _BV(ADC1D);
  // The first conversion, which initializes the converter, measures ground.
  ADMUX = kAdcSupplyReference | board::kGroundChannel;
  ADCSRA = kAdcSilent | _BV(ADSC);
}

void set_up_serial() {
  UCSR0A = _BV(U2X0);
  UBRR0 = kDivisor;
  UCSR0C = _BV(UCSZ01) | _BV(UCSZ00);
  UCSR0B = _BV(RXEN0) | _BV(TXEN0) | _BV(RXCIE0);
  // A zero ends any partial packet from before the reset.
  UDR0 = 0;
}

void remember_reset() {
  if (kept.magic != kMagic || (reset_cause & _BV(PORF))) kept = {kMagic, 0, 0, false, false};
  if (kept.unfed_ticks > kHungTicks) reset_cause |= _BV(WDRF);
  if (reset_cause & _BV(WDRF)) kept.watchdog = true;
  kept.unfed_ticks = 0;
}

}  // namespace

// After its reset the watchdog stays enabled with the shortest time-out: disable it before main.
void first_thing() __attribute__((naked, used, section(".init3")));
void first_thing() {
  reset_cause = MCUSR;
  MCUSR = 0;
  wdt_disable();
}

// The first time-out of the watchdog restarts the program without the bootloader, because an old
// bootloader does not disable the watchdog and would reset forever. If interrupts are off, the
// second time-out resets the processor. All peripheral registers are set to their values after a
// reset, and pending flags are cleared by writing ones.
ISR(WDT_vect, ISR_NAKED) {
  cli();
  for (uint16_t address = kFirstRegister; address <= RAMSTART - 1; ++address) {
    if (address == kStackLow || address == kStackHigh || address == kStatus) continue;
    *reinterpret_cast<volatile uint8_t*>(address) = 0;
  }
  TIFR0 = TIFR1 = TIFR2 = 0xFF;
  board::clear_timer_flags();
  ADCSRA = _BV(ADIF);
  ADCSRA = 0;
  asm volatile("jmp 0");
}

ISR(CLOCK_OVERFLOW_vect) { ++overflows; }

ISR(TIMER0_OVF_vect) {
  ticked = true;
  if (kept.unfed_ticks != 0xFF) ++kept.unfed_ticks;
}

ISR(TIMER1_COMPA_vect) {
  const bool due = scanner.ticks_left == 0;
  schedule_frame();
  if (due) begin_scan();
}

// The compare unit makes the edges, so that no other interrupt delays them; this handler prepares
// the next edge. A started pulse is completed.
ISR(TIMER1_COMPB_vect) {
  servo.is_high = !servo.is_high;
  if (servo.is_high) {
    if (servo.ticks != 0) servo.pulse_ticks = servo.ticks;
    OCR1B = static_cast<uint16_t>(OCR1B + servo.pulse_ticks);
    TCCR1A = _BV(COM1B1);
  } else if (servo.ticks == 0) {
    TCCR1A = 0;
    TIMSK1 &= static_cast<uint8_t>(~_BV(OCIE1B));
  } else {
    OCR1B = static_cast<uint16_t>(OCR1B + kServoPeriodTicks - servo.pulse_ticks);
    TCCR1A = _BV(COM1B1) | _BV(COM1B0);
  }
}

ISR(SETTLED_vect) {
  board::stop_settling();
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

ISR(SERIAL_UDRE_vect) {
  const uint8_t sending = transmitter.sending;
  UDR0 = transmitter.bytes[sending][transmitter.at++];
  if (transmitter.at != transmitter.size[sending]) return;
  transmitter.at = 0;
  transmitter.size[sending] = 0;
  transmitter.sending = sending ^ 1;
  if (transmitter.size[sending ^ 1] == 0) UCSR0B &= static_cast<uint8_t>(~_BV(UDRIE0));
}

ISR(SERIAL_RX_vect) {
  const uint8_t byte = UDR0;
  const uint8_t next = (receiver.head + 1) & (sizeof receiver.bytes - 1);
  // If the buffer is full, the byte is lost, and the CRC rejects its command.
  if (next == receiver.tail) return;
  receiver.bytes[receiver.head] = byte;
  receiver.head = next;
}

namespace {

bool byte_waits() { return receiver.tail != receiver.head && arduino.transmit_buffer() != nullptr; }
bool scan_waits() { return scanner.ready && arduino.transmit_buffer() != nullptr; }

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

// Sleep until there is work, at most 1.024 ms. No interrupt can occur between the check and the
// sleep. A sleeping processor also disturbs the converter less.
void rest() {
  cli();
  while (!ticked && !byte_waits() && !scan_waits()) {
    sleep_enable();
    sei();
    sleep_cpu();
    sleep_disable();
    cli();
  }
  ticked = false;
  sei();
}

}  // namespace

int main() {
  remember_reset();
  set_up_pins();
  TCCR1A = 0;
  TCCR1B = _BV(CS11);
  // Timer 0 at 16 MHz / 64 wakes the main loop every 1.024 ms.
  TCCR0A = 0;
  TCCR0B = _BV(CS01) | _BV(CS00);
  TIMSK0 = _BV(TOIE0);
  board::set_up_timers();
  set_up_serial();
  set_up_converter();
  arduino.stop_scanning();
  set_sleep_mode(SLEEP_MODE_IDLE);
  wdt_enable(WDTO_250MS);
  WDTCSR |= _BV(WDIE);
  sei();
  device.begin(reset_cause, kept.stream_seed, kept.watchdog, kept.tripped);
  for (;;) {
    wdt_reset();
    kept.unfed_ticks = 0;
    if (byte_waits()) take_byte();
    if (scan_waits()) take_scan();
    poll_load_cells();
    device.poll();
    rest();
  }
}
