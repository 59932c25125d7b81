// The state machine: follows the generated table and latches the first fault.
#ifndef MACHINE_H
#define MACHINE_H

#include "drum_states.h"  // states, events, faults, transitions, outputs

class Machine {
  public:
    State state() const { return state_; }
    Outputs outputs() const { return flash::load(&OUTPUTS[static_cast<uint8_t>(state_)]); }
    Drive drive() const { return static_cast<Drive>(outputs().drive); }

    bool accepts(Event event) const { return target(event) != REFUSED; }
    // Follows the event; false where the table refuses it.
    bool handle(Event event);

    // Latches the fault unless an earlier one other than Heartbeat is latched, and follows the table.
    void raise(Fault fault, uint32_t now_ms);
    // Clears the latched fault; the caller has checked that its cause is gone.
    bool clear();

    Fault fault() const { return fault_; }
    uint32_t fault_at_ms() const { return fault_at_ms_; }

  private:
    uint8_t target(Event event) const;

    State state_ = State::Boot;
    Fault fault_ = Fault::None;
    uint32_t fault_at_ms_ = 0;
};

#endif  // MACHINE_H
