// The zero that the board learns by itself.
#include "check.h"
#include "zero.h"

namespace {

// So many readings of one value; true when one of them made it the zero.
bool weighed(Zero &zero, int32_t raw, int count = Zero::PAUSE + Zero::SAMPLES) {
    bool learned = false;
    for (int i = 0; i < count; ++i) learned |= zero.weigh(raw);
    return learned;
}

}  // namespace

TEST(a_zero_is_learned_from_readings_in_a_row_and_followed_while_it_drifts) {
    Zero zero;
    CHECK(!zero.exceeded(8388607));
    CHECK(!weighed(zero, 80000, Zero::PAUSE + Zero::SAMPLES - 1));
    CHECK(zero.weigh(80000));
    CHECK_EQUAL(zero.counts(), 80000);
    for (int32_t drifted = 80000; drifted < 400000; drifted += 40000) CHECK(weighed(zero, drifted));
}

TEST(readings_before_a_disturbance_count_no_more) {
    Zero zero;
    weighed(zero, 500000, Zero::PAUSE + Zero::SAMPLES - 1);
    zero.disturb();
    CHECK(weighed(zero, 80000));
    CHECK_EQUAL(zero.counts(), 80000);
}

TEST(a_zero_does_not_jump_unless_it_is_told_to) {
    Zero zero;
    weighed(zero, 80000);
    CHECK(!weighed(zero, 80000 + 250000));
    CHECK_EQUAL(zero.counts(), 80000);
    zero.take(330000);
    CHECK_EQUAL(zero.counts(), 330000);
}

TEST(the_limit_lies_as_far_above_the_zero_as_below_it) {
    for (int32_t at : {-6000000, 0, 6000000}) {
        Zero zero;
        zero.take(at);
        for (int sign : {-1, 1}) {
            CHECK(!zero.exceeded(at + sign * board::MOST_COUNTS));
            CHECK(zero.exceeded(at + sign * (board::MOST_COUNTS + 1)));
            CHECK(zero.free(at + sign * 8333));
            CHECK(!zero.free(at + sign * 8334));
        }
    }
}
