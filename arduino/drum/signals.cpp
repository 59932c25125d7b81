#include "signals.h"

#include "ports.h"  // wires that the chip itself reads and drives

bool Signals::configure(uint8_t fitted, uint8_t inverted) {
    constexpr uint8_t OF_A_LIFT = 1 << static_cast<uint8_t>(Signal::EndSwitches) |
                                  1 << static_cast<uint8_t>(Signal::Position);
    const uint8_t changed = (fitted ^ fitted_) | (inverted ^ inverted_);
    fitted_ = fitted;
    inverted_ = inverted;
    ports::wire_signals(fitted, inverted);
    if (changed & OF_A_LIFT) left_top_ = false;
    return changed & OF_A_LIFT;
}

// A reading beyond the resistors at the ends, or a faster one than any rod, is not a position.
void Signals::watch_position() {
    constexpr uint16_t MOST_UM_A_MS = board::ACTUATOR_MAX_MM_S * 10;
    const uint16_t now_um = inputs_.position_um, raw = inputs_.position_raw;
    const uint16_t moved_um = now_um > shown_um_ ? now_um - shown_um_ : shown_um_ - now_um;
    shown_um_ = now_um;
    const bool broken = raw <= board::POSITION_BROKEN_LOW || raw >= board::POSITION_BROKEN_HIGH ||
                        moved_um > MOST_UM_A_MS;
    if (!broken || !fitted(Signal::Position)) broken_ms_ = 0;
    else if (broken_ms_ < BROKEN_MS) ++broken_ms_;
}

void Signals::watch_upper_end() {
    if (!end_up()) left_top_ = true;
    if (!says_top() || !reads_position() || !far_from_top()) apart_ms_ = 0;
    else if (apart_ms_ < BROKEN_MS) ++apart_ms_;
}

void Signals::update(const Inputs &inputs) {
    inputs_ = inputs;
    watch_position();
    if (inverted(Signal::Index)) inputs_.index_high = !inputs.index_high;
    if (inverted(Signal::EndSwitches)) {
        inputs_.end_up = !inputs.end_up;
        inputs_.end_down = !inputs.end_down;
    }
    if (inverted(Signal::Position))
        inputs_.position_um = inputs.position_um < board::ACTUATOR_TRAVEL_UM
                                  ? board::ACTUATOR_TRAVEL_UM - inputs.position_um
                                  : 0;
    watch_upper_end();
}
