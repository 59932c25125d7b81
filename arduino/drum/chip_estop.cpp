// INT5: the emergency stop, normally closed to ground. Opening it, or breaking its wire, lets
// the pull-up raise the input; the interrupt switches every output off, so it works even if the
// main loop hangs. Outputs stay off until the controller has read the stop and it is closed.
#include <avr/interrupt.h>
#include <avr/io.h>
#include <util/atomic.h>

#include "chip.h"
#include "isr_meter.h"
#include "steady_level.h"
#include "variant.h"

namespace {

volatile bool latched;
volatile bool fitted = true;
bool told;  // how it is wired
volatile uint8_t open_level = pins::ESTOP;  // what the input shows when it is open

inline bool open() {
    const uint8_t level = open_level;
    return steady_level(PINE, pins::ESTOP, level ^ pins::ESTOP) == level;
}

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
    EICRB = (EICRB & ~_BV(ISC51)) | _BV(ISC50);  // either edge: the wire may be inverted
    EIMSK |= _BV(INT5);
}

// Levels before the first configuration are ignored. Later an opening is latched until the
// controller has read it, because a change of the wiring could hide it.
void wire(bool is_fitted, bool inverted) {
    const uint8_t level = inverted ? 0 : pins::ESTOP;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        fitted = is_fitted;
        open_level = level;
        latched = (told && latched) || (fitted && open());
        told = true;
    }
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
