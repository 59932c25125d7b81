// INT5: the emergency stop, normally closed to ground. Opening it, or breaking its wire, lets
// the pull-up raise the input; the interrupt switches every output off by itself, so it works
// with a main loop that hangs. Outputs stay off until the brain has seen it and it is closed.
#include <avr/interrupt.h>
#include <avr/io.h>
#include <util/atomic.h>

#include "chip.h"
#include "chip_pins.h"
#include "isr_meter.h"
#include "ports.h"

namespace {

volatile bool latched;
volatile bool fitted = true;

inline bool open() { return PINE & pins::ESTOP; }

inline void trip() {
    latched = true;
    stepper::cut();
    bridge::cut();
}

}  // namespace

ISR(INT5_vect) {
    const IsrMeter meter;
    if (fitted && open()) trip();
}

namespace estop {

void begin() {
    PORTE |= pins::ESTOP;
    EICRB |= _BV(ISC51) | _BV(ISC50);
#ifndef NO_ESTOP_INTERRUPT  // a broken image that the tests must catch
    EIMSK |= _BV(INT5);
#endif
}

void check_level() {
    if (fitted && open() && !latched) trip();
}

bool tripped() { return latched; }

bool take() {
    bool seen = false;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        seen = latched || open();
        latched = fitted && open();
    }
    return seen;
}

}  // namespace estop

namespace ports {

void watch_estop(bool is_fitted) { fitted = is_fitted; }

}  // namespace ports
