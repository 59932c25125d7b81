/* One board: load its image, run it slice by slice, reset it. */
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include "avr_eeprom.h"
#include "avr_extint.h"
#include "sim_elf.h"

#include "analog.h"
#include "bridge.h"
#include "loadcell.h"
#include "motor.h"
#include "pins.h"
#include "profile.h"
#include "sensor.h"
#include "serial.h"
#include "sim.h"

#define FREQUENCY 16000000
#define MILLIVOLTS 5000
#define MCUSR_ADDRESS 0x54 /* the same on both chips */
#define EXTERNAL_INTERRUPTS 8
#define BURST_CYCLES 1000
#define EEPROM_REJECTED (-2) /* simavr returns −1 for success */

struct sim_board {
    struct chip chip;
    int was_reset;
    int keep_edges; /* a reset from outside has reported edges since the last run */
    void (*chip_reset)(struct avr_t *avr);
    struct serial serial;
    struct pins pins;
    struct analog analog;
    struct profile profile;
    struct sensor sensor;     /* taxels */
    struct loadcell loadcell; /* drum, as are the next two */
    struct motor motor;
    struct bridge bridge;
};

static const char *const MCU[] = {"atmega2560", "atmega328p"};

/* Count sleep instead of sleeping in real time, as simavr would. */
static void on_sleep(avr_t *avr, avr_cycle_count_t cycles)
{
    sim_board *board = avr->custom.data;
    board->chip.io.slept_cycles += cycles + 1;
}

/* Discard simavr's log: standard output belongs to the program around it. */
static void on_log(avr_t *avr, const int level, const char *format, va_list arguments)
{
    (void)avr, (void)level, (void)format, (void)arguments;
}

/* This timer ends simavr's burst at the slice's end. It re-registers itself because simavr calls due
 * timers before it computes how long to sleep: without it, a chip that fell asleep in a slice's last
 * cycle slept until its own next timer, and 3 of 15,000 slices ended 400 to 1,250 cycles late. */
static avr_cycle_count_t on_stop(avr_t *avr, avr_cycle_count_t when, void *param)
{
    (void)when, (void)param;
    return avr->cycle + 1;
}

static uint64_t earliest(const sim_board *board)
{
    uint64_t next = pins_next(&board->pins), other = serial_next(&board->serial);
    if (other < next) next = other;
    if (board->chip.kind == SIM_DRUM && (other = loadcell_next(&board->loadcell)) < next) next = other;
    return next;
}

static avr_cycle_count_t on_event(avr_t *avr, avr_cycle_count_t when, void *param)
{
    sim_board *board = param;
    (void)when;
    pins_run(&board->pins, avr->cycle);
    serial_run(&board->serial, avr->cycle);
    if (board->chip.kind == SIM_DRUM) loadcell_run(&board->loadcell, avr->cycle);
    uint64_t next = earliest(board);
    return next == NEVER ? 0 : next;
}

/* Register the timer for all events from outside the chip. */
static void schedule(sim_board *board)
{
    uint64_t next = earliest(board), now = board->chip.avr->cycle;
    if (next == NEVER) return;
    avr_cycle_timer_register(board->chip.avr, next > now ? next - now : 1, on_event, board);
}

static void on_reset(avr_t *avr)
{
    sim_board *board = avr->custom.data;
    if (board->chip_reset) board->chip_reset(avr);
    board->was_reset = 1;
}

/* After a reset simavr checks its timers after every instruction. Timers end a burst anyway, so
 * longer bursts give the same cycles in half the time. */
static void bound_burst(sim_board *board)
{
    board->chip.avr->run_cycle_limit = board->chip.io.watch_interrupts ? 1 : BURST_CYCLES;
}

static void on_clock(void *param, int level)
{
    sim_board *board = param;
    loadcell_clock(&board->loadcell, level);
    schedule(board);
}

/* During a reset all pins are inputs, so the wiring decides every level. */
static void restore_pins(sim_board *board)
{
    if (board->chip.kind == SIM_DRUM) {
        pins_float(&board->pins);
        bridge_changed(&board->bridge);
        motor_show_mark(&board->motor);
    }
    pins_restore(&board->pins);
}

/* Restore what a reset clears: level-triggered pins, pin states, timers, receiver state. */
static void restore(sim_board *board)
{
    avr_t *avr = board->chip.avr;
    board->was_reset = 0;
    board->analog.compare_latched = 0;
    /* Strict level triggering polls each low pin every few cycles and halves the speed. */
    for (int n = 0; n < EXTERNAL_INTERRUPTS; n++) avr_extint_set_strict_lvl_trig(avr, n, 0);
    bound_burst(board);
    profile_restore(&board->profile);
    serial_restore(&board->serial);
    restore_pins(board);
    if (board->chip.kind == SIM_DRUM) loadcell_restore(&board->loadcell);
    if (board->chip.slice_end > avr->cycle)
        avr_cycle_timer_register(avr, board->chip.slice_end - avr->cycle, on_stop, board);
    schedule(board);
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
    firmware.frequency = FREQUENCY; /* before loading, which derives baud and ADC clocks from it */
    avr_load_firmware(avr, &firmware);
    avr->frequency = FREQUENCY;
    avr->log = LOG_NONE;
    avr->sleep = on_sleep;
    return avr;
}

static void open_peripherals(sim_board *board)
{
    struct chip *chip = &board->chip;
    struct pins *pins = &board->pins;
    serial_open(&board->serial, chip);
    analog_open(&board->analog, chip, &board->sensor);
    pins_open(pins, chip);
    if (chip->kind == SIM_DRUM) {
        motor_open(&board->motor, chip, pins);
        bridge_open(&board->bridge, chip, pins);
        loadcell_open(&board->loadcell, chip, pins);
        pins->on_clock = on_clock;
        pins->clock_param = board;
    } else {
        sensor_open(&board->sensor, chip);
    }
    profile_open(&board->profile, chip);
}

/* The converter's reference is the supply. */
static void supply(sim_board *board)
{
    avr_t *avr = board->chip.avr;
    avr->vcc = avr->avcc = avr->aref = board->chip.io.supply_mv;
}

sim_board *sim_open(const char *image, int kind)
{
    if (kind != SIM_DRUM && kind != SIM_TAXELS) return NULL;
    avr_t *avr = load(image, MCU[kind]);
    if (!avr) return NULL;
    sim_board *board = calloc(1, sizeof *board);
    board->chip.avr = avr;
    board->chip.kind = kind;
    avr->custom.data = board;
    board->chip_reset = avr->reset;
    avr->reset = on_reset;
    board->chip.io.supply_mv = MILLIVOLTS;
    supply(board);
    open_peripherals(board);
    sim_reset(board, SIM_POWER_ON);
    board->chip.io.resets = 0;
    return board;
}

void sim_close(sim_board *board)
{
    avr_terminate(board->chip.avr);
    free(board->chip.avr);
    free(board);
}

sim_io *sim_io_of(sim_board *board) { return &board->chip.io; }

unsigned long sim_io_size(void) { return sizeof(sim_io); }

/* Prepare for edges outside of a run; they belong to the next run. */
static void begin_outside(sim_board *board)
{
    if (!board->keep_edges) board->chip.io.edge_count = 0;
    board->keep_edges = 1;
}

static void begin(sim_board *board, uint64_t until)
{
    board->chip.slice_start = board->chip.avr->cycle;
    board->chip.slice_end = until;
    board->chip.io.tx_count = 0;
    if (!board->keep_edges) board->chip.io.edge_count = 0;
    board->keep_edges = 0;
    serial_begin(&board->serial);
    pins_begin(&board->pins);
    bound_burst(board);
    supply(board);
    if (board->chip.kind == SIM_DRUM) {
        loadcell_begin(&board->loadcell);
        bridge_begin(&board->bridge);
        motor_show_mark(&board->motor); /* the wiring may have changed */
    }
    avr_cycle_timer_register(board->chip.avr, until - board->chip.avr->cycle, on_stop, board);
    schedule(board);
}

int sim_run(sim_board *board, uint64_t until)
{
    avr_t *avr = board->chip.avr;
    if (until <= avr->cycle) return 0;
    begin(board, until);
    int state = cpu_Running;
    while (avr->cycle < until && state != cpu_Done && state != cpu_Crashed) {
        state = avr_run(avr);
        if (board->chip.io.watch_interrupts) profile_instruction(&board->profile);
        if (board->was_reset) {
            board->chip.io.resets++;
            restore(board);
        }
    }
    if (board->chip.kind == SIM_DRUM) motor_end(&board->motor), bridge_end(&board->bridge);
    board->chip.io.cycle = avr->cycle;
    board->chip.io.bridge_on = board->pins.out_level[SIM_OUT_BRIDGE];
    board->chip.io.stepper_on = !board->pins.out_level[SIM_OUT_ENABLE];
    board->chip.io.loadcell_ready = (uint64_t)board->loadcell.ready_q16 >> 16;
    return state == cpu_Done || state == cpu_Crashed;
}

void sim_reset(sim_board *board, int cause)
{
    avr_t *avr = board->chip.avr;
    begin_outside(board);
    avr_reset(avr);
    avr->data[MCUSR_ADDRESS] = cause;
    if (cause == SIM_POWER_ON) memset(avr->data + avr->ioend + 1, 0, avr->ramend - avr->ioend);
    board->chip.io.resets++;
    board->chip.slice_end = avr->cycle;
    restore(board);
}

void sim_place_drum(sim_board *board, int64_t steps)
{
    begin_outside(board);
    motor_place(&board->motor, steps);
    restore_pins(board);
}

int sim_eeprom_read(sim_board *board, uint32_t offset, uint8_t *bytes, uint32_t size)
{
    avr_eeprom_desc_t range = {.ee = bytes, .offset = offset, .size = size};
    if (offset + size > board->chip.avr->e2end + 1u) return 1;
    return avr_ioctl(board->chip.avr, AVR_IOCTL_EEPROM_GET, &range) == EEPROM_REJECTED;
}

int sim_eeprom_write(sim_board *board, uint32_t offset, const uint8_t *bytes, uint32_t size)
{
    avr_eeprom_desc_t range = {.ee = (uint8_t *)bytes, .offset = offset, .size = size};
    if (offset + size > board->chip.avr->e2end + 1u) return 1;
    return avr_ioctl(board->chip.avr, AVR_IOCTL_EEPROM_SET, &range) == EEPROM_REJECTED;
}

int sim_flash_read(sim_board *board, uint32_t offset, uint8_t *bytes, uint32_t size)
{
    if (offset + size > board->chip.avr->flashend + 1u) return 1;
    memcpy(bytes, board->chip.avr->flash + offset, size);
    return 0;
}

int sim_flash_write(sim_board *board, uint32_t offset, const uint8_t *bytes, uint32_t size)
{
    if (offset + size > board->chip.avr->flashend + 1u) return 1;
    memcpy(board->chip.avr->flash + offset, bytes, size);
    return 0;
}

void sim_start_at(sim_board *board, uint32_t address) { board->chip.avr->reset_pc = address; }
