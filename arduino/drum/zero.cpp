#include "zero.h"

bool Zero::weigh(int32_t raw) {
    --left_;
    if (left_ >= SAMPLES) {
        first_ = raw;
        sum_ = 0;
        return false;
    }
    sum_ += raw - first_;
    if (left_) return false;
    disturb();
    const int32_t mean = first_ + sum_ / SAMPLES;
    if (known_ && !near(mean)) return false;
    take(mean);
    return true;
}

void Zero::take(int32_t counts) {
    counts_ = counts;
    known_ = true;
}

bool Zero::exceeded(int32_t raw) const {
    return known_ && !within(raw, most_counts_);
}
