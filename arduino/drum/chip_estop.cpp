// INT5: the emergency stop, normally closed to ground. Opening it, or breaking its wire, lets
// the pull-up raise the input; the interrupt switches every output off, so it works even if the
// main loop hangs. Outputs stay off until the controller has read the stop and it is closed.
// Should an edge be lost, the tick notices, and timer 3 calls another interrupt for the looks.
#include <avr/interrupt.h>
#include <avr/io.h>
#include <util/atomic.h>

#include "chip.h"
#include "isr_meter.h"
#include "steady_level.h"
#include "variant.h"

namespace {

constexpr uint16_t SOON = 8;  // counts of timer 3, 4 µs

volatile bool latched;
volatile bool fitted = true;
bool told;  // how it is wired
volatile uint8_t open_level = pins::ESTOP;  // what the input shows when it is open

// Takes 11 µs where the first look shows an opening.
inline bool reads(uint8_t level) {
    return steady_level(PINE, pins::ESTOP, level ^ pins::ESTOP) == level;
}

inline bool open() { return fitted && reads(open_level); }

inline void trip() {
    latched = true;
    stepper::cut();
    bridge::cut();
}

}  // namespace

// An edge of the stop's wire, whichever: three looks, and all off. 380 cycles, 24 µs, when it trips;
// `estop_us` adds what it waits for other interrupts.
ISR(INT5_vect) {
    const IsrMeter meter;
    if (open()) trip();
}

// The tick saw an open stop: the same. 385 cycles, 24 µs.
ISR(TIMER3_COMPB_vect) {
    const IsrMeter meter;
    TIMSK3 &= ~_BV(OCIE3B);
    if (open()) trip();
}

namespace estop {

void begin() {
    PORTE |= pins::ESTOP;
    EICRB = (EICRB & ~_BV(ISC51)) | _BV(ISC50);  // either edge: the wire may be inverted
    EIMSK |= _BV(INT5);
}

// Levels before the first configuration are ignored. Later an opening is latched until the
// controller has read it, because a change of the wiring could hide it.
void wire(bool is_fitted, bool inverted) {
    const uint8_t level = inverted ? 0 : pins::ESTOP;
    const bool is_open = is_fitted && reads(level);
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        fitted = is_fitted;
        open_level = level;
        latched = (told && latched) || is_open;
        told = true;
    }
}

void check_in_isr() {
    if (latched || !fitted || (PINE & pins::ESTOP) != open_level) return;
    OCR3B = TCNT3 + SOON;
    TIFR3 = _BV(OCF3B);
    TIMSK3 |= _BV(OCIE3B);
}

bool tripped() { return latched; }

bool take() {
    const bool is_open = reads(open_level);
    bool seen = false;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        seen = latched || is_open;
        latched = fitted && is_open;
    }
    return seen;
}

}  // namespace estop
