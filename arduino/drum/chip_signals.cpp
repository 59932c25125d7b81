// Passes the configuration of the optional wires to the files that read or drive them.
#include "chip.h"
#include "drum_map.h"
#include "ports.h"

namespace {

bool has(uint8_t bits, Signal signal) { return bits >> static_cast<uint8_t>(signal) & 1; }

}  // namespace

namespace ports {

void wire_signals(uint8_t fitted, uint8_t inverted) {
    estop::wire(has(fitted, Signal::Estop), has(inverted, Signal::Estop));
    stepper::wire_index(has(inverted, Signal::Index));
    stepper::wire_sync(has(fitted, Signal::Sync), has(inverted, Signal::Sync));
}

}  // namespace ports
