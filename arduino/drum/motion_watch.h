// Whether the actuator goes where its duty says: by the potentiometer, and by the end switches.
//
// After a boot, an emergency stop and a change of its wires nothing is known of that. The first
// motion then is a nudge: its duty rises until the rod has moved 0.1 mm the right way. Without a
// reading of the position the duty still rises, and the ends and the force have to speak.
#ifndef MOTION_WATCH_H
#define MOTION_WATCH_H

#include <stdint.h>

#include "actuator.h"  // full duty
#include "signals.h"   // position, end switches

class MotionWatch {
  public:
    enum class Finding : uint8_t { None, Reversed, Stuck };

    static constexpr int16_t PROGRESS_UM = 100;  // two counts of the potentiometer

    // The wires may have been changed.
    void forget();
    // The bridge is off: the next duty begins another motion.
    void end() { way_ = 0; }
    // A nudge went the right way.
    void confirm() { known_ = true; }
    bool known() const { return known_; }

    // The next ramp begins at rest.
    void begin_ramp() { ramped_way_ = 0; }
    // Once a millisecond: the part of a duty that is allowed now. A gentle motion is a ramp, whether
    // its way is known or not.
    int16_t limited(int16_t duty, bool gentle);
    // The rod has made no progress for longer than any lag.
    bool stands() const { return still_ms_ == STILL_MS; }
    // Once a millisecond, with the duty of the one before.
    Finding check(int16_t duty, const Signals &signals);

  private:
    void begin(int8_t way, uint16_t position_um);
    void progressed(uint16_t position_um);
    void watch_rest(int16_t duty);
    int32_t along(uint16_t from_um, uint16_t to_um) const {
        return way_ > 0 ? static_cast<int32_t>(to_um) - from_um : static_cast<int32_t>(from_um) - to_um;
    }
    bool wrong_end(const Signals &signals) const;
    Finding compare(int16_t duty, const Signals &signals);

    static constexpr uint8_t STILL_MS = 250;

    bool known_ = false;
    uint8_t still_ms_ = 0;       // since the rod last made progress
    int8_t ramped_way_ = 0;      // of the ramp: 1 presses, -1 lifts
    int16_t ramp_ = 0;           // permille
    int8_t way_ = 0;             // of the motion under observation, 0: none
    uint8_t rest_ms_ = 255;      // since the last duty
    int16_t recent_ = 0;         // duty that the rod's speed may still have, permille
    int16_t coast_um_ = 0;       // how far it may still go the other way
    uint8_t clear_up_ms_ = 0, clear_down_ms_ = 0;  // since that end was last seen
    uint16_t start_um_ = 0;      // where the rod was when it last made progress
    uint16_t from_um_ = 0;       // the furthest the wrong way since then
    uint32_t owed_ = 0;          // duty above every dead band since then, permille × ms
};

#endif  // MOTION_WATCH_H
