/* An Arduino Mega 2560, Uno or Nano on simavr with its wiring: pixels behind two multiplexers, a
 * pressure regulator, a servo signal, two HX711 load-cell amplifiers, and a serial line at its real
 * speed. Controlled from Python with ctypes (palpate.twin.firmware). Test tool only: simavr is
 * GPL-3. */
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <simavr/avr_adc.h>
#include <simavr/avr_ioport.h>
#include <simavr/avr_timer.h>
#include <simavr/avr_uart.h>
#include <simavr/sim_avr.h>
#include <simavr/sim_elf.h>
#include <simavr/sim_hex.h>
#include <simavr/sim_time.h>

#define CLOCK_HZ 16000000u
#define PIXELS 256
#define OUT_BYTES (1u << 20)
#define IN_BYTES 4096u
#define LOAD_CELLS 2
#define LOAD_PERIOD_CYCLES (CLOCK_HZ / 80)
#define SUPPLY_MV 5000.0
#define REGULATOR_LAG_S 0.05

#define PULSES 4096u

/* Data-space addresses (register summaries of the ATmega2560 and ATmega328P data sheets). The
 * direction register of a port is at the address below. */
enum { PORTA_ = 0x22, PORTB_ = 0x25, PORTC_ = 0x28, PORTD_ = 0x2B, PORTH_ = 0x102, PORTL_ = 0x10B };
enum { TCCR1A_ = 0x80, TCCR3A_ = 0x90, OCR3AL_ = 0x98 };

typedef struct pin {
  uint8_t port, bit;
} pin_t;

/* Data addresses of registers of both chips; time-out flag with reset enable; 250 ms at 16 MHz. */
enum { WDTCSR_ = 0x60, WDTCSR_BOTH = 0x88, MCUSR_ = 0x54, MCUSR_WATCHDOG = 8 };
#define WATCHDOG_CYCLES 4000000

/* A field of bits of a port. */
typedef struct field {
  uint16_t address;
  uint8_t first, mask;
} field_t;

/* Wiring of a board, as in the tables of firmware/board. */
typedef struct wiring {
  const char *chip;
  field_t row, col, lines_low, lines_high, safe, servo;
  pin_t safe_pin, clock[LOAD_CELLS], data[LOAD_CELLS];
} wiring_t;

static const wiring_t WIRINGS[] = {
    {"atmega2560", {PORTL_, 0, 15}, {PORTL_, 4, 15}, {PORTA_, 0, 255}, {PORTC_, 0, 255}, {PORTH_, 5, 1},
     {PORTB_, 6, 1}, {'H', 5}, {{'G', 0}, {'G', 2}}, {{'J', 1}, {'D', 7}}},
    {"atmega328p", {PORTD_, 2, 3}, {PORTD_, 4, 3}, {PORTC_, 2, 15}, {PORTC_, 0, 0}, {PORTB_, 0, 1},
     {PORTB_, 2, 1}, {'B', 0}, {{'D', 6}, {'B', 3}}, {{'D', 7}, {'B', 4}}},
};

typedef struct load_cell {
  avr_t *avr;
  pin_t data;
  uint64_t ready_cycle;
  int32_t raw, shift;
  int pulses, clock;
} load_cell_t;

typedef struct board {
  avr_t *avr;
  const wiring_t *wiring;
  avr_irq_t *adc, *uart_in;
  float from_mv[PIXELS], to_mv[PIXELS];
  uint64_t from_cycle, to_cycle;
  float noise_mv;
  uint64_t random;
  uint64_t conversions, misrouted;
  double pressure;
  uint64_t pressure_cycle;
  load_cell_t loads[LOAD_CELLS];
  uint8_t out[OUT_BYTES];
  uint64_t out_cycle[OUT_BYTES];
  uint32_t out_size, out_lost;
  uint8_t in[IN_BYTES];
  uint32_t in_head, in_tail;
  uint32_t byte_cycles;
  uint32_t safe_edges;
  int safe_level;
  uint64_t timeout_cycle;
  uint64_t rise_cycle, pulse_cycle[PULSES];
  uint32_t pulse_cycles[PULSES], pulses;
} board_t;

static int read_field(const board_t *board, field_t field) {
  return board->avr->data[field.address] >> field.first & field.mask;
}

static int is_output(const board_t *board, field_t field) {
  return board->avr->data[field.address - 1] >> field.first & field.mask;
}

static double uniform(board_t *board) {
  board->random ^= board->random << 13;
  board->random ^= board->random >> 7;
  board->random ^= board->random << 17;
  return (double)(board->random >> 11) / 9007199254740992.0;
}

static double gaussian(board_t *board) {
  double sum = -6.0;
  for (int i = 0; i < 12; i++) sum += uniform(board);
  return sum;
}

static double output_duty(const board_t *board) {
  const uint8_t *data = board->avr->data;
  if (!(data[TCCR3A_] & 0x80)) return 0.0;
  return ((data[OCR3AL_] | data[OCR3AL_ + 1] << 8) + 1) / 1024.0;
}

/* First-order regulator between the pulse output and its read-back, as a fraction of full scale. */
static double pressure_now(board_t *board) {
  double elapsed_s = (double)(board->avr->cycle - board->pressure_cycle) / CLOCK_HZ;
  board->pressure_cycle = board->avr->cycle;
  double wanted = output_duty(board);
  board->pressure = wanted + (board->pressure - wanted) * exp(-elapsed_s / REGULATOR_LAG_S);
  return board->pressure;
}

/* Whether the direct row lines agree with the multiplexer: only the selected row is high. */
static int rows_agree(const board_t *board, int row) {
  const wiring_t *wiring = board->wiring;
  return (read_field(board, wiring->lines_low) | read_field(board, wiring->lines_high) << 8) == 1 << row;
}

static double pixel_mv(board_t *board) {
  int row = read_field(board, board->wiring->row), col = read_field(board, board->wiring->col);
  int pixel = row * 16 + col;
  if (!rows_agree(board, row)) board->misrouted++;
  double span = (double)(board->to_cycle - board->from_cycle);
  double fraction = span > 0 ? (double)(board->avr->cycle - board->from_cycle) / span : 1.0;
  if (fraction < 0) fraction = 0;
  if (fraction > 1) fraction = 1;
  return (1.0 - fraction) * board->from_mv[pixel] + fraction * board->to_mv[pixel];
}

static void on_convert(avr_irq_t *irq, uint32_t value, void *param) {
  (void)irq;
  board_t *board = param;
  union {
    avr_adc_mux_t mux;
    uint32_t value;
  } request = {.value = value};
  int pin = request.mux.kind == ADC_MUX_SINGLE ? request.mux.src : -1; /* -1: ground */
  double mv = 0;
  if (pin == 0) {
    mv = pixel_mv(board);
    board->conversions++;
  } else if (pin == 1) {
    mv = SUPPLY_MV * pressure_now(board);
  }
  mv += board->noise_mv * gaussian(board);
  /* The first ideal transition is half a step above zero (data sheet, "ADC Accuracy Definitions"),
   * so a count is V * 1024 / Vref rounded. simavr uses whole millivolts and a factor of 1023, so
   * the voltage is converted to one that results in the correct count. */
  double count = floor(mv * 1024.0 / SUPPLY_MV + 0.5);
  if (count < 0) count = 0;
  if (count > 1023) count = 1023;
  avr_raise_irq(board->adc + request.mux.src, (uint32_t)ceil(count * SUPPLY_MV / 1023.0));
}

static void on_sent(avr_irq_t *irq, uint32_t value, void *param) {
  (void)irq;
  board_t *board = param;
  if (board->out_size == OUT_BYTES) {
    board->out_lost++;
    return;
  }
  /* The transmission of the byte ends with its stop bit. */
  board->out_cycle[board->out_size] = board->avr->cycle + board->byte_cycles;
  board->out[board->out_size++] = (uint8_t)value;
}

static avr_cycle_count_t on_receive(avr_t *avr, avr_cycle_count_t when, void *param) {
  (void)avr;
  board_t *board = param;
  if (board->in_head == board->in_tail) return 0;
  avr_raise_irq(board->uart_in, board->in[board->in_tail++ % IN_BYTES]);
  return when + board->byte_cycles;
}

static avr_irq_t *irq_of(avr_t *avr, pin_t pin) {
  return avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ(pin.port), pin.bit);
}

/* Also sets the external level of the pin; otherwise a write would restore its pull-up. */
static void set_load_data(load_cell_t *cell, int level) {
  uint8_t mask = (uint8_t)(1 << cell->data.bit);
  avr_ioport_external_t held = {.name = cell->data.port, .mask = mask, .value = level ? mask : 0};
  avr_ioctl(cell->avr, AVR_IOCTL_IOPORT_SET_EXTERNAL(cell->data.port), &held);
  avr_raise_irq(irq_of(cell->avr, cell->data), (uint32_t)level);
}

static avr_cycle_count_t on_load_ready(avr_t *avr, avr_cycle_count_t when, void *param) {
  (void)avr;
  load_cell_t *cell = param;
  cell->pulses = 0;
  cell->shift = cell->raw;
  set_load_data(cell, 0);
  return when + LOAD_PERIOD_CYCLES;
}

static void on_load_clock(avr_irq_t *irq, uint32_t value, void *param) {
  (void)irq;
  load_cell_t *cell = param;
  int rising = value && !cell->clock;
  cell->clock = (int)value;
  if (!rising) return;
  int bit = cell->pulses < 24 ? (cell->shift >> (23 - cell->pulses)) & 1 : 1;
  cell->pulses++;
  set_load_data(cell, bit);
}

static void on_safe_line(avr_irq_t *irq, uint32_t value, void *param) {
  (void)irq;
  board_t *board = param;
  int level = value != 0;
  board->safe_edges += level != board->safe_level;
  board->safe_level = level;
}

/* Records start and length of each pulse of the compare unit; if the buffer is full, new pulses are
 * dropped. simavr also changes the pin of a compare at each overflow, as in its PWM modes, always
 * opposite to the compare mode; these changes are ignored. */
static void on_servo(avr_irq_t *irq, uint32_t value, void *param) {
  (void)irq;
  board_t *board = param;
  uint64_t now = board->avr->cycle;
  int mode = board->avr->data[TCCR1A_] >> 4 & 3; /* 2: clear on match, 3: set */
  if (mode != (value ? 3 : 2) || !is_output(board, board->wiring->servo)) return;
  if (value) {
    board->rise_cycle = now;
  } else if (board->rise_cycle && board->pulses < PULSES) {
    board->pulse_cycle[board->pulses] = board->rise_cycle;
    board->pulse_cycles[board->pulses++] = (uint32_t)(now - board->rise_cycle);
    board->rise_cycle = 0;
  }
}

static void no_sleep(avr_t *avr, avr_cycle_count_t cycles) {
  (void)avr;
  (void)cycles;
}

static void quiet(avr_t *avr, const int level, const char *format, va_list args) {
  (void)avr, (void)level, (void)format, (void)args;
}

static void connect(board_t *board) {
  avr_t *avr = board->avr;
  board->adc = avr_io_getirq(avr, AVR_IOCTL_ADC_GETIRQ, 0);
  avr_irq_register_notify(board->adc + ADC_IRQ_OUT_TRIGGER, on_convert, board);

  uint32_t flags = 0;
  avr_ioctl(avr, AVR_IOCTL_UART_GET_FLAGS('0'), &flags);
  flags &= ~(uint32_t)(AVR_UART_FLAG_STDIO | AVR_UART_FLAG_POLL_SLEEP);
  avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);
  board->uart_in = avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_INPUT);
  avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUTPUT), on_sent,
                          board);

  const wiring_t *wiring = board->wiring;
  avr_irq_register_notify(irq_of(avr, wiring->safe_pin), on_safe_line, board);
  avr_irq_t *timer = avr_io_getirq(avr, AVR_IOCTL_TIMER_GETIRQ('1'), TIMER_IRQ_OUT_COMP + 1);
  avr_irq_register_notify(timer, on_servo, board);
  for (int i = 0; i < LOAD_CELLS; i++) {
    board->loads[i].avr = avr;
    board->loads[i].data = wiring->data[i];
    avr_irq_register_notify(irq_of(avr, wiring->clock[i]), on_load_clock, &board->loads[i]);
    set_load_data(&board->loads[i], 1);
  }
}

/* Returns null if the chip is unknown, or the file is not an ELF that simavr can run. */
board_t *board_open(const char *chip, const char *elf, uint32_t baud, uint64_t seed) {
  const wiring_t *wiring = NULL;
  for (size_t i = 0; i < sizeof WIRINGS / sizeof *WIRINGS; i++) {
    if (strcmp(WIRINGS[i].chip, chip) == 0) wiring = &WIRINGS[i];
  }
  if (!wiring) return NULL;
  avr_global_logger_set(quiet);
  elf_firmware_t firmware = {0};
  if (elf_read_firmware(elf, &firmware) != 0) return NULL;
  board_t *board = calloc(1, sizeof *board);
  avr_t *avr = board ? avr_make_mcu_by_name(chip) : NULL;
  if (!avr) {
    free(board);
    return NULL;
  }
  board->avr = avr;
  board->wiring = wiring;
  board->random = seed * 0x9E3779B97F4A7C15u | 1;
  board->byte_cycles = CLOCK_HZ / baud * 10;
  avr_init(avr);
  avr->frequency = firmware.frequency = CLOCK_HZ;
  avr->vcc = avr->avcc = avr->aref = (uint32_t)SUPPLY_MV;
  firmware.vcc = firmware.avcc = firmware.aref = (uint32_t)SUPPLY_MV;
  avr_load_firmware(avr, &firmware);
  avr->sleep = no_sleep;
  avr->log = LOG_NONE;
  connect(board);
  return board;
}

/* Loads a bootloader (Intel hex) and starts it, now and after every reset, like the fuses of a
 * purchased board. Returns 0, or -1 if the file can't be read or does not fit the flash. */
int board_load_boot(board_t *board, const char *hex) {
  ihex_chunk_p chunks = NULL;
  int count = read_ihex_chunks(hex, &chunks);
  if (count <= 0) return -1;
  avr_t *avr = board->avr;
  avr->reset_pc = chunks[0].baseaddr;
  for (int i = 0; i < count; i++) {
    if (chunks[i].baseaddr + chunks[i].size > avr->flashend + 1) return -1;
    memcpy(avr->flash + chunks[i].baseaddr, chunks[i].data, chunks[i].size);
  }
  avr->codeend = avr->flashend;
  free_ihex_chunks(chunks);
  avr_reset(avr);
  return 0;
}

void board_close(board_t *board) {
  avr_terminate(board->avr);
  free(board->avr);
  free(board);
}

uint64_t board_cycle(const board_t *board) { return board->avr->cycle; }
uint64_t board_conversions(const board_t *board) { return board->conversions; }
uint64_t board_misrouted(const board_t *board) { return board->misrouted; }
uint32_t board_out_lost(const board_t *board) { return board->out_lost; }
double board_output_duty(const board_t *board) { return output_duty(board); }
double board_pressure(board_t *board) { return pressure_now(board); }
/* The line is high only as an output; otherwise its pull-down keeps it low. */
int board_safe_line(const board_t *board) {
  return read_field(board, board->wiring->safe) & is_output(board, board->wiring->safe);
}
uint32_t board_safe_edges(const board_t *board) { return board->safe_edges; }
void board_reset(board_t *board) { avr_reset(board->avr); }
void board_set_noise_mv(board_t *board, float noise_mv) { board->noise_mv = noise_mv; }

/* Changes every pixel linearly from its last target to `mv` (16 x 16) at `cycle`. */
void board_set_pixels(board_t *board, const float *mv, uint64_t cycle) {
  memcpy(board->from_mv, board->to_mv, sizeof board->from_mv);
  memcpy(board->to_mv, mv, sizeof board->to_mv);
  board->from_cycle = board->avr->cycle;
  board->to_cycle = cycle;
}

/* Connects an amplifier with a reading; without an amplifier the line stays high. */
void board_set_load(board_t *board, int index, int32_t raw) {
  load_cell_t *cell = &board->loads[index];
  cell->raw = raw;
  if (!cell->ready_cycle) {
    cell->ready_cycle = board->avr->cycle + LOAD_PERIOD_CYCLES;
    avr_cycle_timer_register(board->avr, LOAD_PERIOD_CYCLES, on_load_ready, cell);
  }
}

/* Makes the program hang, as after a particle hit; interrupts continue. */
void board_hang(board_t *board) {
  const avr_flashaddr_t nowhere = board->avr->flashend / 2 & ~1u; /* above the program */
  board->avr->flash[nowhere] = 0xFF; /* rjmp to itself */
  board->avr->flash[nowhere + 1] = 0xCF;
  board->avr->pc = nowhere;
}

/* Sets four bytes of the memory, such as a variable of the program. */
void board_set_memory(board_t *board, uint32_t address, uint32_t value) {
  memcpy(board->avr->data + address, &value, sizeof value);
}

/* Queues bytes for the receiver of the board; returns the number of queued bytes. */
uint32_t board_give(board_t *board, const uint8_t *bytes, uint32_t size) {
  uint32_t given = 0;
  int idle = board->in_head == board->in_tail;
  while (given < size && board->in_head - board->in_tail < IN_BYTES) {
    board->in[board->in_head++ % IN_BYTES] = bytes[given++];
  }
  if (idle && given) avr_cycle_timer_register(board->avr, board->byte_cycles, on_receive, board);
  return given;
}

/* Moves the sent bytes to `bytes`, and the cycle at the end of each byte to `cycles`. */
uint32_t board_take(board_t *board, uint8_t *bytes, uint64_t *cycles) {
  uint32_t size = board->out_size;
  memcpy(bytes, board->out, size);
  memcpy(cycles, board->out_cycle, size * sizeof *cycles);
  board->out_size = 0;
  return size;
}

/* Moves the servo pulses since the last call: start cycle, and length in cycles. */
uint32_t board_take_pulses(board_t *board, uint64_t *began, uint32_t *cycles) {
  uint32_t count = board->pulses;
  memcpy(began, board->pulse_cycle, count * sizeof *began);
  memcpy(cycles, board->pulse_cycles, count * sizeof *cycles);
  board->pulses = 0;
  return count;
}

/* Data sheet, "Interrupt and System Reset Mode": if the first time-out is not served before the
 * next, the processor is reset. simavr only raises the interrupt again. */
static void watch_second_timeout(board_t *board) {
  avr_t *avr = board->avr;
  if ((avr->data[WDTCSR_] & WDTCSR_BOTH) != WDTCSR_BOTH) {
    board->timeout_cycle = 0;
  } else if (!board->timeout_cycle) {
    board->timeout_cycle = avr->cycle;
  } else if (avr->cycle - board->timeout_cycle > WATCHDOG_CYCLES) {
    board->timeout_cycle = 0;
    avr_reset(avr);
    avr->data[MCUSR_] |= MCUSR_WATCHDOG;
  }
}

/* Runs up to a cycle; returns 0, or -1 if the program has crashed. */
int board_run(board_t *board, uint64_t until) {
  while (board->avr->cycle < until) {
    int state = avr_run(board->avr);
    if (state == cpu_Done || state == cpu_Crashed) return -1;
    watch_second_timeout(board);
  }
  return 0;
}
