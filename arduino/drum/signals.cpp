#include "signals.h"

#include "ports.h"  // wires that the chip itself reads and drives

bool Signals::configure(uint8_t fitted, uint8_t inverted) {
    constexpr uint8_t OF_A_LIFT = 1 << static_cast<uint8_t>(Signal::EndSwitches) |
                                  1 << static_cast<uint8_t>(Signal::Position);
    const uint8_t changed = (fitted ^ fitted_) | (inverted ^ inverted_);
    fitted_ = fitted;
    inverted_ = inverted;
    ports::wire_signals(fitted, inverted);
    return changed & OF_A_LIFT;
}

void Signals::update(const Inputs &inputs) {
    inputs_ = inputs;
    if (inverted(Signal::Index)) inputs_.index_high = !inputs.index_high;
    if (inverted(Signal::EndSwitches)) {
        inputs_.end_up = !inputs.end_up;
        inputs_.end_down = !inputs.end_down;
    }
    if (inverted(Signal::Position))
        inputs_.position_um = inputs.position_um < board::ACTUATOR_TRAVEL_UM
                                  ? board::ACTUATOR_TRAVEL_UM - inputs.position_um
                                  : 0;
}
