#include "feel.h"

namespace {

constexpr int32_t ALIKE_COUNTS = board::counts_of(10);
constexpr int32_t BACK_COUNTS = board::counts_of(20);
constexpr int32_t AWAY_COUNTS = board::counts_of(50);
constexpr uint8_t ENOUGH = 8;  // samples
// A level that lasts for longer is where the cell rests now: 2 s at 80 samples a second.
constexpr uint8_t LASTING = 160;

}  // namespace

void Feel::take(int32_t raw) {
    if (!based_) alike_ = 0;
    if (!alike_ || !within(raw, first_, ALIKE_COUNTS)) {
        first_ = raw;
        alike_ = 0;
    }
    if (alike_ < ENOUGH) ++alike_;
    const bool steady = alike_ == ENOUGH;
    if (!based_) {
        base_ = raw;
        away_ = 0;
        had_before_ = false;
        based_ = true;
    } else if (!within(raw, base_, AWAY_COUNTS)) {
        if (away_ < LASTING) ++away_;
        if (away_ == LASTING && steady) rest(raw);
    } else if (steady) {
        rest(raw);
    }
}

// The reading stays where it is now, which is where it was before something was felt.
void Feel::rest(int32_t raw) {
    const bool back = within(raw, base_, BACK_COUNTS);
    const bool back_before = had_before_ && within(raw, before_, BACK_COUNTS);
    if ((back && away_ >= ENOUGH) || (back_before && !back)) {
        felt_ = true;
        level_ = raw;
    }
    if (away_ == LASTING) {
        before_ = base_;
        had_before_ = true;
    }
    base_ = raw;
    away_ = 0;
}
