// The start of the program, before main(): cause of the reset, and paint on the stack.
#include "chip_reset.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/wdt.h>

extern uint8_t _end;  // first byte behind all variables

namespace {

constexpr uint8_t PAINT = 0xc5;
constexpr uint32_t WATCHED = 0x57a7c4ed;
constexpr uint8_t HUNG_MS = 32;  // half the watchdog's time; a loop that lives leaves 1

// A reset keeps this memory, which no bootloader uses: what the program was doing when it ended.
uint32_t watched __attribute__((section(".noinit")));  // WATCHED: the watchdog was on
bool watched_before __attribute__((section(".noinit")));
uint8_t saved_cause __attribute__((section(".noinit")));
uint16_t unused;

}  // namespace

namespace reset {
volatile uint8_t unkicked_ms __attribute__((section(".noinit")));
}  // namespace reset

// Before anything else: after a watchdog reset the watchdog still runs. Bootloaders clear MCUSR, and
// a Mega's jumps here with interrupts on after a watchdog reset, or starts once more. A hang is then
// known from the milliseconds without a kick, unless interrupts were off and nothing counted.
extern "C" void keep_reset_cause() __attribute__((naked, used, section(".init3")));
extern "C" void keep_reset_cause() {
    cli();
    saved_cause = MCUSR;
    MCUSR = 0;
    wdt_disable();
    watched_before = watched == WATCHED;
    const bool hung = watched_before && reset::unkicked_ms >= HUNG_MS;
    if (hung && !(saved_cause & _BV(PORF))) saved_cause |= _BV(WDRF);
    watched = 0;
}

// Paints the memory between the variables and the stack, before any call.
extern "C" void paint_stack() __attribute__((naked, used, section(".init5")));
extern "C" void paint_stack() {
    const uint8_t *const top = reinterpret_cast<uint8_t *>(SP);
    for (uint8_t *byte = &_end; byte < top; ++byte) *byte = PAINT;
}

namespace reset {

uint8_t cause() { return saved_cause; }
bool was_watched() { return watched_before; }

void watch() {
    wdt_enable(WDTO_60MS);
    unkicked_ms = 0;
    watched = WATCHED;
}

void kick() {
    wdt_reset();
    unkicked_ms = 0;
}

}  // namespace reset

namespace stack {

void begin() {
    const uint8_t *at = &_end;
    while (*at == PAINT) ++at;
    unused = at - &_end;
}

void look(uint8_t bytes) {
    static const uint8_t *seen_to = &_end;
    const uint8_t *at = seen_to;
    while (bytes && *at == PAINT) --bytes, ++at;
    if (bytes) unused = at - &_end;
    seen_to = bytes ? &_end : at;
}

uint16_t unused_bytes() { return unused; }

}  // namespace stack
