// The input wires of one tick, as the settings say that they are fitted and inverted.
#ifndef SIGNALS_H
#define SIGNALS_H

#include <stdint.h>

#include "drum_map.h"  // wires
#include "variant.h"   // travel

struct Inputs {
    uint32_t now_ms;
    uint16_t position_um, position_raw;
    bool estop_open, end_up, end_down, index_high;
};

class Signals {
  public:
    // Applies the settings, as bits of Signal. Returns true when a wire that ends a lift changed.
    bool configure(uint8_t fitted, uint8_t inverted);
    void update(const Inputs &inputs);

    // As last configured: while a write is checked, the bank already has its words.
    bool fitted(Signal signal) const { return fitted_ >> static_cast<uint8_t>(signal) & 1; }
    uint32_t now_ms() const { return inputs_.now_ms; }
    uint16_t position_um() const { return inputs_.position_um; }
    // The potentiometer's reading of ten bits, as converted.
    uint16_t position_raw() const { return inputs_.position_raw; }
    bool index_high() const { return inputs_.index_high; }
    bool estop_wire_open() const { return inputs_.estop_open; }
    bool estop_open() const { return fitted(Signal::Estop) && inputs_.estop_open; }
    bool end_up() const { return fitted(Signal::EndSwitches) && inputs_.end_up; }
    bool end_down() const { return fitted(Signal::EndSwitches) && inputs_.end_down; }
    // The upper switch says so, and another wire supports it, because its own reads alike when it is
    // broken: the potentiometer, which is not far from the top, or without one the switch itself,
    // which has read otherwise since the boot.
    bool at_upper_end() const {
        return says_top() && (reads_position() ? !far_from_top() : left_top_);
    }
    // Both end switches together mean broken or wrongly configured wires, and say nothing.
    bool says_top() const { return end_up() && !end_down(); }
    // The potentiometer is fitted, and its reading is one that whole wires give.
    bool reads_position() const { return fitted(Signal::Position) && !broken_ms_; }
    // Its wires are broken or shorted, or the upper switch says something else; and not for one
    // reading only.
    bool position_broken() const { return broken_ms_ >= BROKEN_MS || apart_ms_ >= BROKEN_MS; }
    // The actuator at an end of its travel, by the potentiometer.
    bool at_top() const {
        return reads_position() && inputs_.position_um <= board::ACTUATOR_END_UM;
    }
    bool at_bottom() const {
        constexpr uint16_t BOTTOM_UM = board::ACTUATOR_TRAVEL_UM - board::ACTUATOR_END_UM;
        return reads_position() && inputs_.position_um >= BOTTOM_UM;
    }

  private:
    static constexpr uint8_t BROKEN_MS = 8;

    void watch_position();
    void watch_upper_end();
    bool far_from_top() const { return inputs_.position_um > board::ACTUATOR_TRAVEL_UM / 10; }
    bool inverted(Signal signal) const { return inverted_ >> static_cast<uint8_t>(signal) & 1; }

    Inputs inputs_ = {0, 0, 0, false, false, false, false};
    uint16_t shown_um_ = 0;              // position of the tick before
    uint8_t broken_ms_ = 0;              // how long the potentiometer gives no reading
    uint8_t apart_ms_ = 0;               // how long it contradicts the upper switch
    bool left_top_ = false;              // the upper switch has read otherwise since the boot
    uint8_t fitted_ = 0, inverted_ = 0;  // bits of Signal
};

#endif  // SIGNALS_H
