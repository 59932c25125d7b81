// Which step comes when: a motion's ramps, its end, and the two marks of the trial window.
//
// The step interrupt requests one interval at a time and reports each step. All decisions are in
// steps, so a motion ends on the exact step at any speed.
#ifndef STEP_ENGINE_H
#define STEP_ENGINE_H

#include <stdint.h>

#include "ramp.h"  // intervals

// More steps than any motion has, and still positive with a sign.
constexpr uint32_t ENDLESS = 0x7fffffffUL;

struct Motion {
    Profile profile;
    bool backwards;
    uint32_t steps;        // ENDLESS: until stopped
    uint32_t sync_on_at;   // step at which the trial window opens, ENDLESS: never
    uint32_t sync_length;  // steps the window is open; after it the motion stops
};

enum class Mark : uint8_t { None, SyncOn, SyncOff };

class StepEngine {
  public:
    void begin(const Motion &motion);
    void stop() { stopping_ = true; }
    // Ends the motion immediately, without a ramp; for faults that switch everything off.
    void abandon() { interval_ = 0; }

    // Interval before the next step in cycles times 256; 0 when the motion is over.
    uint32_t next_interval();
    // The step was made.
    Mark count_step();

    bool moving() const { return interval_ != 0; }
    bool at_speed() const { return moving() && at_speed_; }
    uint32_t interval() const { return interval_; }
    bool backwards() const { return backwards_; }
    int32_t position() const { return position_; }
    void set_position(int32_t position) { position_ = position; }
    // Steps a stop would take from here.
    uint16_t steps_to_stop() const { return index_; }

  private:
    Profile profile_ = {0, 0};
    int32_t position_ = 0;
    uint32_t remaining_ = 0;
    uint32_t to_mark_ = ENDLESS;
    uint32_t sync_length_ = 0;
    uint32_t interval_ = 0;
    uint16_t index_ = 0;
    bool backwards_ = false;
    bool stopping_ = false, at_speed_ = false;
    bool sync_ = false;
};

#endif  // STEP_ENGINE_H
