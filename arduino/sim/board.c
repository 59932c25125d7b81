/* One board: loading its image, running it slice by slice, resetting it. */
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include "board.h"
#include "avr_eeprom.h"
#include "avr_extint.h"
#include "sim_elf.h"

#define FREQUENCY 16000000
#define MILLIVOLTS 5000
#define MCUSR_ADDRESS 0x54 /* the same on both chips */
#define EXTERNAL_INTERRUPTS 8
#define BURST_CYCLES 1000
#define EEPROM_REFUSED (-2) /* simavr answers −1 when it has done it */

static const char *const MCU[] = {"atmega2560", "atmega328p"};

/* simavr would sleep for real; here the world sets the pace. */
static void on_sleep(avr_t *avr, avr_cycle_count_t cycles)
{
    sim_board *board = avr->custom.data;
    board->exchange.slept_cycles += cycles + 1;
}

/* simavr tells its standard output what it loads; that belongs to the program around it. */
static void on_log(avr_t *avr, const int level, const char *format, va_list arguments)
{
    (void)avr, (void)level, (void)format, (void)arguments;
}

/* Its presence alone ends simavr's burst at a slice's end, and it stays there: simavr calls what is
 * due before it asks how long to sleep. A chip that fell asleep in a slice's last cycle slept on to
 * its own next timer: of 15,000 slices three ended 400 to 1,250 cycles late, the drum farther on. */
static avr_cycle_count_t on_stop(avr_t *avr, avr_cycle_count_t when, void *param)
{
    (void)when, (void)param;
    return avr->cycle + 1;
}

static uint64_t earliest(const sim_board *board)
{
    uint64_t next = pins_next(board), other = serial_next(board);
    if (other < next) next = other;
    if (board->kind == SIM_DRUM && (other = loadcell_next(board)) < next) next = other;
    return next;
}

static avr_cycle_count_t on_event(avr_t *avr, avr_cycle_count_t when, void *param)
{
    sim_board *board = param;
    (void)when;
    pins_run(board, avr->cycle);
    serial_run(board, avr->cycle);
    if (board->kind == SIM_DRUM) loadcell_run(board, avr->cycle);
    uint64_t next = earliest(board);
    return next == NEVER ? 0 : next;
}

/* Registers the one timer behind all events that come from outside the chip. */
void schedule(sim_board *board)
{
    uint64_t next = earliest(board), now = board->avr->cycle;
    if (next == NEVER) return;
    avr_cycle_timer_register(board->avr, next > now ? next - now : 1, on_event, board);
}

static void on_reset(avr_t *avr)
{
    sim_board *board = avr->custom.data;
    if (board->chip_reset) board->chip_reset(avr);
    board->was_reset = 1;
}

/* A reset leaves simavr looking at its timers after every instruction; they bound a burst by
 * themselves, so longer ones give the same cycles in half the time. */
static void bound_burst(sim_board *board)
{
    board->avr->run_cycle_limit = board->exchange.watch_interrupts ? 1 : BURST_CYCLES;
}

/* What every reset undoes: level-triggered pins, pin states, timers, receiver state. */
static void restore(sim_board *board)
{
    board->was_reset = 0;
    board->compare_latched = 0;
    /* Strict level triggering polls each low pin every few cycles and halves the speed. */
    for (int n = 0; n < EXTERNAL_INTERRUPTS; n++) avr_extint_set_strict_lvl_trig(board->avr, n, 0);
    bound_burst(board);
    profile_restore(board);
    serial_restore(board);
    pins_restore(board);
    if (board->kind == SIM_DRUM) loadcell_restore(board);
    if (board->slice_end > board->avr->cycle)
        avr_cycle_timer_register(board->avr, board->slice_end - board->avr->cycle, on_stop, board);
    schedule(board);
}

/* simavr's own structure of a peripheral; the first of its kind in its list. */
avr_io_t *find_io(avr_t *avr, const char *kind)
{
    avr_io_t *io = avr->io_port;
    while (io && strcmp(io->kind, kind)) io = io->next;
    return io;
}

static avr_t *load(const char *image, const char *mcu)
{
    elf_firmware_t firmware;
    memset(&firmware, 0, sizeof firmware);
    avr_global_logger_set(on_log);
    if (elf_read_firmware(image, &firmware)) return NULL;
    avr_t *avr = avr_make_mcu_by_name(mcu);
    if (!avr) return NULL;
    avr_init(avr);
    firmware.frequency = FREQUENCY; /* before loading: baud and ADC clocks are taken from it */
    avr_load_firmware(avr, &firmware);
    avr->frequency = FREQUENCY;
    avr->vcc = avr->avcc = avr->aref = MILLIVOLTS;
    avr->log = LOG_NONE;
    avr->sleep = on_sleep;
    return avr;
}

sim_board *sim_open(const char *image, int kind)
{
    if (kind != SIM_DRUM && kind != SIM_TAXELS) return NULL;
    avr_t *avr = load(image, MCU[kind]);
    if (!avr) return NULL;
    sim_board *board = calloc(1, sizeof *board);
    board->avr = avr;
    board->kind = kind;
    avr->custom.data = board;
    board->chip_reset = avr->reset;
    avr->reset = on_reset;
    serial_open(board);
    analog_open(board);
    pins_open(board);
    if (kind == SIM_DRUM) loadcell_open(board);
    else sensor_open(board);
    profile_open(board);
    sim_reset(board, 1);
    board->exchange.resets = 0;
    return board;
}

void sim_close(sim_board *board)
{
    avr_terminate(board->avr);
    free(board->avr);
    free(board);
}

sim_exchange *sim_exchange_of(sim_board *board) { return &board->exchange; }

unsigned long sim_exchange_size(void) { return sizeof(sim_exchange); }

void report_edge(sim_board *board, int signal, int level)
{
    report_edge_at(board, board->avr->cycle, signal, level);
}

void report_edge_at(sim_board *board, uint64_t cycle, int signal, int level)
{
    sim_exchange *x = &board->exchange;
    if (x->edge_count == SIM_MAX_EDGES) {
        x->overflows++;
        return;
    }
    x->edge_cycle[x->edge_count] = cycle;
    x->edge_signal[x->edge_count] = signal;
    x->edge_level[x->edge_count++] = level;
}

/* Outside of a run: what is reported now belongs to the next one. */
static void begin_outside(sim_board *board)
{
    if (!board->keep_edges) board->exchange.edge_count = 0;
    board->keep_edges = 1;
}

static void begin(sim_board *board, uint64_t until)
{
    board->slice_start = board->avr->cycle;
    board->slice_end = until;
    board->exchange.tx_count = 0;
    if (!board->keep_edges) board->exchange.edge_count = 0;
    board->keep_edges = 0;
    serial_begin(board);
    pins_begin(board);
    bridge_begin(board);
    bound_burst(board);
    if (board->kind == SIM_DRUM) motor_show_mark(board); /* the wiring may be another */
    avr_cycle_timer_register(board->avr, until - board->avr->cycle, on_stop, board);
    schedule(board);
}

int sim_run(sim_board *board, uint64_t until)
{
    avr_t *avr = board->avr;
    if (until <= avr->cycle) return 0;
    begin(board, until);
    int state = cpu_Running;
    while (avr->cycle < until && state != cpu_Done && state != cpu_Crashed) {
        state = avr_run(avr);
        if (board->exchange.watch_interrupts) profile_look(board);
        if (board->was_reset) {
            board->exchange.resets++;
            restore(board);
        }
    }
    if (board->kind == SIM_DRUM) motor_end(board), bridge_end(board);
    board->exchange.cycle = avr->cycle;
    board->exchange.loadcell_ready = (uint64_t)board->loadcell.ready_q16 >> 16;
    return state == cpu_Done || state == cpu_Crashed;
}

void sim_reset(sim_board *board, int cause)
{
    avr_t *avr = board->avr;
    begin_outside(board);
    avr_reset(avr);
    avr->data[MCUSR_ADDRESS] = cause == 1 ? 1 : 2;
    if (cause == 1) memset(avr->data + avr->ioend + 1, 0, avr->ramend - avr->ioend);
    board->exchange.resets++;
    board->slice_end = avr->cycle;
    restore(board);
}

void sim_place_drum(sim_board *board, int64_t steps)
{
    begin_outside(board);
    board->drum = (struct drum){
        .steps = steps, .from = steps, .index_pin = board->drum.index_pin};
    board->exchange.drum_steps = steps;
    board->exchange.drum_place = steps;
    pins_restore(board);
}

int sim_eeprom_read(sim_board *board, uint32_t offset, uint8_t *bytes, uint32_t size)
{
    avr_eeprom_desc_t what = {.ee = bytes, .offset = offset, .size = size};
    if (offset + size > board->avr->e2end + 1u) return 1;
    return avr_ioctl(board->avr, AVR_IOCTL_EEPROM_GET, &what) == EEPROM_REFUSED;
}

int sim_eeprom_write(sim_board *board, uint32_t offset, const uint8_t *bytes, uint32_t size)
{
    avr_eeprom_desc_t what = {.ee = (uint8_t *)bytes, .offset = offset, .size = size};
    if (offset + size > board->avr->e2end + 1u) return 1;
    return avr_ioctl(board->avr, AVR_IOCTL_EEPROM_SET, &what) == EEPROM_REFUSED;
}

uint8_t sim_peek(sim_board *board, uint32_t address) { return board->avr->data[address]; }
