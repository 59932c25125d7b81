// Watchdog, cause of the last reset, unused stack, and how much of its time the chip slept.
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
#include <avr/wdt.h>
#include <util/atomic.h>

#include "chip.h"
#include "isr_meter.h"
#include "ports.h"

extern uint8_t _end;  // first byte behind all variables
extern uint8_t __stack;

volatile uint16_t IsrMeter::longest;
volatile uint16_t IsrMeter::sum;

namespace {

constexpr uint8_t PAINT = 0xc5;
constexpr uint16_t SECOND_MS = 1000;
constexpr uint16_t CYCLES_PER_PERMILLE = 16000;

// A reset keeps this memory, which no bootloader uses: what the program was doing when it ended.
constexpr uint32_t WATCHED = 0x57a7c4ed;
constexpr uint8_t HUNG_MS = 32;  // half the watchdog's time; a tick that comes on time leaves 1
uint32_t watched __attribute__((section(".noinit")));  // WATCHED: the watchdog was on
uint8_t unkicked_ms __attribute__((section(".noinit")));
uint8_t reset_cause __attribute__((section(".noinit")));
uint16_t late_ticks;
uint32_t slept_cycles;
uint16_t slept_in_tick;  // short, because every interrupt's wake adds to it
uint16_t idle_permille;
uint16_t second_ms;
uint16_t unused_stack;

// The stack grows down into the paint and may leave holes in it, so the few bytes below the known
// mark are checked for deeper traces.
void look_at_stack() {
    constexpr uint8_t REACH = 16;
    for (uint8_t below = 1; below <= REACH && below <= unused_stack; ++below) {
        if ((&_end)[unused_stack - below] == PAINT) continue;
        unused_stack -= below;
        below = 0;
    }
}

}  // namespace

// Before anything else: after a watchdog reset the watchdog still runs. A Mega's bootloader clears
// MCUSR, and after a watchdog reset it jumps here with interrupts on, or starts once more. A hang is
// then known from the ticks without a kick, unless interrupts were off and nothing counted.
extern "C" void keep_reset_cause() __attribute__((naked, used, section(".init3")));
extern "C" void keep_reset_cause() {
    cli();
    reset_cause = MCUSR;
    MCUSR = 0;
    wdt_disable();
    const bool hung = watched == WATCHED && unkicked_ms >= HUNG_MS;
    if (hung && !(reset_cause & _BV(PORF))) reset_cause |= _BV(WDRF);
    watched = 0;
}

// Paints the memory between the variables and the stack, before any call.
extern "C" void paint_stack() __attribute__((naked, used, section(".init5")));
extern "C" void paint_stack() {
    const uint8_t *const top = reinterpret_cast<uint8_t *>(SP);
    for (uint8_t *byte = &_end; byte < top; ++byte) *byte = PAINT;
}

namespace health {

void begin() {
    const uint8_t *byte = &_end;
    while (*byte == PAINT && byte < &__stack) ++byte;
    unused_stack = byte - &_end;
    set_sleep_mode(SLEEP_MODE_IDLE);
    sleep_enable();
    // 64 ms on the chip: less than the 100 ms in which a hang has to end.
    wdt_enable(WDTO_60MS);
    unkicked_ms = 0;
    watched = WATCHED;
}

bool watchdog_reset() { return reset_cause & _BV(WDRF); }

void count_tick_in_isr() {
    if (unkicked_ms < UINT8_MAX) ++unkicked_ms;
}

void kick() {
    wdt_reset();
    unkicked_ms = 0;
    slept_cycles += slept_in_tick;
    slept_in_tick = 0;
    if (++second_ms < SECOND_MS) return;
    second_ms = 0;
    idle_permille = slept_cycles / CYCLES_PER_PERMILLE;
    slept_cycles = 0;
}

void count_late(uint8_t ticks) { late_ticks += ticks; }

// Sleep ends with an interrupt, whose duration does not count as sleep. Returns with interrupts off.
void sleep_until_interrupt() {
    const uint16_t start = TCNT1;
    IsrMeter::sum = 0;
    sei();
    sleep_cpu();
    // The chip serves the interrupt that woke it before it continues. simavr may need two more
    // instructions for that, and would sleep forever without them.
    asm volatile("nop\n\tnop");
    cli();
    const uint16_t cycles = TCNT1 - start, busy = IsrMeter::sum;
    if (cycles > busy) slept_in_tick += cycles - busy;
}

}  // namespace health

namespace ports {

Health health() {
    uint16_t longest = 0;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { longest = IsrMeter::longest; }
    look_at_stack();
    return {late_ticks,
            static_cast<uint16_t>((longest + IsrMeter::MOST_AROUND_CYCLES) / 16),
            unused_stack,
            idle_permille,
            store::boot_count(),
            reset_cause};
}

}  // namespace ports
