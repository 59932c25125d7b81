// The axis of the drum: its motions, its angle, and the index mark that gives the angle its zero.
#ifndef AXIS_H
#define AXIS_H

#include <stdint.h>

#include "bank.h"         // speeds, ways, trim
#include "force_loop.h"   // angle and speed, as the force loop takes them
#include "step_engine.h"  // motions

class Axis {
  public:
    enum class IndexEvent : uint8_t { None, Homed, StepsLost };

    explicit Axis(const Bank &bank) : bank_(bank) {}

    // Motions. The caller has checked that the drum may turn.
    void move();                     // to move_target at move_speed_set
    void home();                     // to the index mark
    void tare_turn();                // one turn at constant speed, plus ramps and one place
    void run();                      // through the trial window
    bool run_in_suffices() const;    // the ramp and its settling end before the window opens
    // The motion has ended.
    void end_move();
    bool home_missed() const { return home_missed_; }  // that motion should have met the mark

    // Once a millisecond, where the index sensor is fitted: compares the mark with the steps.
    IndexEvent watch_index();
    // Makes the present position zero; the angle is then unknown.
    void zero_position();
    // The driver is off: the drum may be turned by hand.
    void forget_angle() { homed_ = homing_ = false; }
    bool homed() const { return homed_; }

    // Steps since the index mark, within a turn.
    uint16_t place_in_turn() const;
    DrumTurn turn();
    bool backwards() const { return backwards_; }
    uint16_t speed() const;  // 0.01 mm/s
    int16_t index_error() const { return index_error_; }

  private:
    void start(const Motion &motion, uint16_t speed);

    const Bank &bank_;
    uint16_t index_seen_ = 0;
    int32_t index_expected_ = 0;  // position of the last mark, a multiple of a turn
    int16_t index_error_ = 0;
    uint16_t cruise_speed_ = 0;   // 0.01 mm/s
    uint32_t turn_interval_ = 0;  // step interval from which turn_rate_ was computed
    float turn_rate_ = 0;
    bool homing_ = false, homed_ = false, home_missed_ = false;
    bool backwards_ = false;
};

#endif  // AXIS_H
