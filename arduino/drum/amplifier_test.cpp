#include "amplifier_test.h"

#include <math.h>
#include <stdlib.h>

void AmplifierTest::take(int32_t raw, bool fresh) {
    if (!taken_) {
        first_ = before_ = raw;
        sum_ = sum_of_squares_ = 0;
        fresh_ = jumps_ = 0;
    }
    const float off = raw - first_;
    sum_ += off;
    sum_of_squares_ += off * off;
    if (fresh) ++fresh_;
    if (labs(raw - before_) > JUMP_COUNTS) ++jumps_;
    before_ = raw;
    if (++taken_ == (known_ ? SAMPLES : FIRST_SAMPLES)) finish();
}

void AmplifierTest::finish() {
    const float mean = sum_ / taken_;
    const float variance = sum_of_squares_ / taken_ - mean * mean;
    const float noise = variance > 0 ? sqrtf(variance) : 0;
    noise_tenths_ = noise < 6553 ? static_cast<uint16_t>(noise * 10 + 0.5f) : 65535;
    unique_ = fresh_;
    failed_ = noise < QUIET_COUNTS || jumps_ > taken_ / 2 || fresh_ * SAMPLES_PER_VALUE < taken_;
    known_ = true;
    taken_ = 0;
}
