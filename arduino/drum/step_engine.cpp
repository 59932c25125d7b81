#include "step_engine.h"

// Runs inside the step interrupt, also where the IDE builds for size.
#ifdef __AVR__
#pragma GCC optimize("O2")
#endif

void StepEngine::begin(const Motion &motion) {
    profile_ = motion.profile;
    backwards_ = motion.backwards;
    remaining_ = motion.steps;
    to_mark_ = motion.sync_on_at;
    sync_length_ = motion.sync_length;
    index_ = 0;
    stopping_ = false;
    at_speed_ = false;
    sync_ = false;
    interval_ = motion.steps ? profile_.first : 0;
}

// A step of acceleration needs one more step to brake, hence the two that must remain.
uint32_t StepEngine::next_interval() {
    uint16_t index = index_;
    const int32_t spare = static_cast<int32_t>(remaining_ - index);  // ENDLESS counts as many
    const bool brake = stopping_ || spare <= 0;
    if (!brake && (at_speed_ || spare == 1)) return interval_;
    at_speed_ = false;
    if (brake && !index--) return interval_ = 0;
    uint32_t next = ramp::interval(profile_.first, index);
    if (!brake) {
        at_speed_ = next <= profile_.cruise || index == ramp::MAX_INDEX;
        if (at_speed_) next = profile_.cruise;
        else ++index;
    }
    index_ = index;
    return interval_ = next;
}

Mark StepEngine::count_step() {
    position_ += backwards_ ? -1 : 1;
    if (remaining_ < ENDLESS) --remaining_;
    if (to_mark_ == ENDLESS || --to_mark_) return Mark::None;
    sync_ = !sync_;
    to_mark_ = sync_ ? sync_length_ : ENDLESS;
    if (!sync_) stopping_ = true;
    return sync_ ? Mark::SyncOn : Mark::SyncOff;
}
