#include "machine.h"

uint8_t Machine::target(Event event) const {
    return flash::byte_at(
        &TRANSITIONS[static_cast<uint8_t>(state_)][static_cast<uint8_t>(event)]);
}

bool Machine::handle(Event event) {
    const uint8_t next = target(event);
    if (next == REFUSED) return false;
    state_ = static_cast<State>(next);
    return true;
}

void Machine::raise(Fault fault, uint32_t now_ms) {
    // The computer clears Heartbeat by itself, so it hides no other cause.
    if (fault_ == Fault::None || (fault_ == Fault::Heartbeat && fault != fault_)) {
        fault_ = fault;
        fault_at_ms_ = now_ms;
    }
    const bool lifts = LIFT_FAULTS >> static_cast<uint8_t>(fault) & 1;
    handle(lifts ? Event::TimedFault : Event::OffFault);
}

bool Machine::clear() {
    if (!handle(Event::Clear)) return false;
    fault_ = Fault::None;
    fault_at_ms_ = 0;
    return true;
}
