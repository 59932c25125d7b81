// Ramps and motions: exact step counts, exact rates, the acceleration asked for.
#include <vector>

#include "variant.h"
#include "check.h"
#include "ramp_table.h"
#include "step_engine.h"

namespace {

struct Trace {
    std::vector<double> at;  // seconds of each step
    int64_t sync_on = -1, sync_off = -1;
    int32_t position = 0;
};

// Plays a motion to its end; stop_at asks for a ramp down after that many steps.
Trace play(const Motion &motion, int64_t stop_at = -1) {
    StepEngine engine;
    Trace trace;
    engine.begin(motion);
    double cycles = 0;
    while (const uint32_t interval = engine.next_interval()) {
        cycles += interval / 256.0;
        trace.at.push_back(cycles / board::CLOCK_HZ);
        const Mark mark = engine.count_step();
        const auto made = static_cast<int64_t>(trace.at.size());
        if (mark == Mark::SyncOn) trace.sync_on = made;
        if (mark == Mark::SyncOff) trace.sync_off = made;
        if (made == stop_at) engine.stop();
        if (made > 3000000) break;
    }
    CHECK(!engine.moving());
    trace.position = engine.position();
    return trace;
}

Motion by(uint32_t steps, uint16_t speed, uint16_t acceleration, int16_t trim = 0) {
    return {ramp::profile(speed, acceleration, trim), false, steps, ENDLESS, 0};
}

constexpr double MM_PER_STEP = board::NM_PER_STEP * 1e-6;

}  // namespace

TEST(the_table_is_square_roots) {
    for (int n = 0; n < 256; ++n)
        CHECK_NEAR(STEP_SHARES[n], 65536 * (std::sqrt(n + 1.0) - std::sqrt(n)), n ? 0.6 : 1.1);
}

TEST(motions_end_on_the_exact_step) {
    for (uint32_t steps : {1u, 2u, 3u, 4u, 5u, 10u, 11u, 100u, 101u, 767u, 768u, 769u, 12800u, 50000u})
        for (uint16_t speed : {500, 4000, 12000, 32000})
            for (uint16_t acceleration : {50, 600, 2000})
                CHECK_EQUAL(play(by(steps, speed, acceleration)).at.size(), steps);
}

TEST(no_step_at_all_is_no_motion) { CHECK(play(by(0, 8000, 600)).at.empty()); }

TEST(backwards_counts_down) {
    Motion motion = by(1000, 8000, 600);
    motion.backwards = true;
    CHECK_EQUAL(play(motion).position, -1000);
}

TEST(the_mean_rate_is_exact_to_5_ppm) {
    for (int speed = 4000; speed <= 12000; speed += 250) {
        for (int trim : {-5000, -321, 0, 1200, 5000}) {
            const Profile profile = ramp::profile(speed, 600, trim);
            const double seconds = profile.cruise / 256.0 / (board::CLOCK_HZ * (1 + trim * 1e-6));
            const double wanted = MM_PER_STEP / (speed * 0.01);
            CHECK_NEAR(seconds / wanted, 1, 5e-6);
        }
    }
}

TEST(ramps_have_the_acceleration_asked_for) {
    for (uint16_t acceleration : {50, 200, 600, 2000}) {
        const Trace trace = play(by(40000, 12000, acceleration));
        // Distance after a time from rest, s = a t²/2, at several places of the ramp.
        for (double speed : {20.0, 60.0, 110.0}) {
            const auto n = static_cast<size_t>(speed * speed / (2 * acceleration) / MM_PER_STEP);
            if (n < 20) continue;
            const double t = trace.at[n - 1];
            CHECK_NEAR(2 * n * MM_PER_STEP / (t * t) / acceleration, 1, 0.01);
            const size_t last = trace.at.size();
            const double back = trace.at[last - 1] - trace.at[last - 1 - n];
            CHECK_NEAR(2 * n * MM_PER_STEP / (back * back) / acceleration, 1, 0.01);
        }
    }
}

TEST(no_step_is_faster_than_the_set_speed) {
    for (uint16_t speed : {500, 4000, 12000, 30000}) {
        const Motion motion = by(30000, speed, 600);
        const Trace trace = play(motion);
        for (size_t i = 1; i < trace.at.size(); ++i)
            CHECK(trace.at[i] - trace.at[i - 1] > motion.profile.cruise / 256.0 / board::CLOCK_HZ - 1e-9);
    }
}

TEST(the_window_opens_and_closes_on_its_steps_at_constant_speed) {
    for (uint16_t speed : {4000, 8000, 12000}) {
        Motion motion = {ramp::profile(speed, 600, 0), false, ENDLESS, 1920, 7840};
        const Trace trace = play(motion);
        CHECK_EQUAL(trace.sync_on, 1920);
        CHECK_EQUAL(trace.sync_off, 1920 + 7840);
        const double mean = (trace.at[9759] - trace.at[1919]) / 7840;
        CHECK_NEAR(mean * board::CLOCK_HZ, motion.profile.cruise / 256.0, 1e-3);
    }
}

TEST(a_stop_takes_as_many_steps_as_the_start_did) {
    const Motion motion = {ramp::profile(12000, 600, 0), false, ENDLESS, ENDLESS, 0};
    for (int64_t stop_at : {1, 2, 50, 200, 380, 5000}) {
        const Trace trace = play(motion, stop_at);
        const int64_t ramp = std::min<int64_t>(stop_at, 384);
        CHECK_NEAR(trace.at.size(), stop_at + ramp, 2);
    }
}

TEST(steps_to_speed_covers_the_ramp) {
    for (uint16_t speed : {500, 4000, 8000, 12000, 20000})
        for (uint16_t acceleration : {50, 600, 2000}) {
            StepEngine engine;
            engine.begin({ramp::profile(speed, acceleration, 0), false, ENDLESS, ENDLESS, 0});
            uint32_t steps = 0;
            while (engine.next_interval() && !engine.at_speed()) {
                engine.count_step();
                ++steps;
            }
            const uint32_t promised = ramp::steps_to_speed(speed, acceleration);
            CHECK(steps <= promised + promised / 50 + 2);
        }
}
