#include "step_engine.h"

void StepEngine::begin(const Motion &motion) {
    profile_ = motion.profile;
    backwards_ = motion.backwards;
    remaining_ = motion.steps;
    to_mark_ = motion.sync_on_at;
    sync_length_ = motion.sync_length;
    index_ = 0;
    stopping_ = false;
    sync_ = false;
    interval_ = motion.steps ? profile_.first : 0;
}

uint32_t StepEngine::slower() {
    if (!index_) return 0;
    return ramp::interval(profile_.first, --index_);
}

uint32_t StepEngine::faster() {
    const uint32_t next = ramp::interval(profile_.first, index_);
    if (next <= profile_.cruise || index_ >= ramp::MAX_INDEX) return profile_.cruise;
    ++index_;
    return next;
}

// A step of acceleration needs one more step to brake, hence the two that must remain.
uint32_t StepEngine::next_interval() {
    if (!interval_) return 0;
    if (stopping_ || remaining_ <= index_) {
        interval_ = slower();
    } else if (interval_ != profile_.cruise && remaining_ >= index_ + 2UL) {
        interval_ = faster();
    } else if (remaining_ == 1 && !index_) {
        interval_ = profile_.first;
    }
    return interval_;
}

Mark StepEngine::count_step() {
    position_ += backwards_ ? -1 : 1;
    if (remaining_ != ENDLESS) --remaining_;
    if (to_mark_ == ENDLESS || --to_mark_) return Mark::None;
    sync_ = !sync_;
    to_mark_ = sync_ ? sync_length_ : ENDLESS;
    if (!sync_) stopping_ = true;
    return sync_ ? Mark::SyncOn : Mark::SyncOff;
}
