// A small motion of the actuator: its duty rises until the potentiometer has moved a little.
//
// Without a reading it ends with the ramp. Nothing is known before it: which way the actuator goes,
// and from which duty on.
#ifndef NUDGE_H
#define NUDGE_H

#include <stdint.h>

class Nudge {
  public:
    static constexpr uint16_t TRAVEL_UM = 100;  // two counts of the potentiometer

    // `seen`: the position is read, and ends it.
    void begin(bool presses, uint16_t position_um, bool seen);
    // Once a millisecond: the duty for the next one, 0 when it is over.
    int16_t tick(uint16_t position_um);
    // An end of the travel, or the end of the ramp.
    void end() { over_ = true; }
    bool over() const { return over_; }
    bool presses() const { return presses_; }

    int16_t travel_um() const { return travel_um_; }
    // The duty at which the rod began to move, or the last one where it did not.
    uint16_t duty() const { return moved_at_ ? moved_at_ : duty_; }

  private:
    uint16_t start_um_ = 0, duty_ = 0, moved_at_ = 0, ticks_ = 0, most_duty_ = 0;
    int16_t travel_um_ = 0;
    bool presses_ = false, over_ = true;
};

#endif  // NUDGE_H
