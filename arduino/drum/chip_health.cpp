// What the board reports of itself: late ticks, its longest interrupt, unused stack, and how much of
// its time it slept.
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
#include <util/atomic.h>

#include "chip.h"
#include "chip_reset.h"
#include "isr_meter.h"
#include "ports.h"

volatile uint16_t IsrMeter::longest;
volatile uint16_t IsrMeter::sum;

namespace {

constexpr uint16_t SECOND_MS = 1000;
constexpr uint16_t CYCLES_PER_PERMILLE = 16000;
constexpr uint8_t LOOK_BYTES = 4;  // of the stack, a tick

uint16_t late_ticks;
uint32_t slept_cycles;
uint16_t slept_in_tick;  // short, because every interrupt's wake adds to it
uint16_t idle_permille;
uint16_t second_ms;

}  // namespace

namespace health {

void begin() {
    stack::begin();
    set_sleep_mode(SLEEP_MODE_IDLE);
    sleep_enable();
    reset::watch();
}

bool watchdog_reset() { return reset::cause() & _BV(WDRF); }

void kick() {
    reset::kick();
    stack::look(LOOK_BYTES);
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
    return {late_ticks,
            static_cast<uint16_t>((longest + IsrMeter::MOST_AROUND_CYCLES) / 16),
            stack::unused_bytes(),
            idle_permille,
            store::boot_count(),
            reset::cause()};
}

}  // namespace ports
