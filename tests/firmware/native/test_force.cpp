// The force loop in closed loop with the bench, over the plausible range of every parameter.
#include <algorithm>

#include "bench.h"
#include "check.h"

namespace {

struct Outcome {
    double settle_s, overshoot;  // of the 200 ms mean, of the peak over the set force
    double worst_mean_error;     // of a trial window
};

Outcome measure(const BenchParameters &parameters, double force, double speed, int trials = 3) {
    Bench bench(parameters);
    CHECK(bench.arm_and_tare());
    bench.write(reg::speed_set, {static_cast<uint16_t>(speed * 100)});
    std::vector<double> seen;
    bench.each_ms = [&] {
        if (bench.force_g > 0 || !seen.empty()) seen.push_back(bench.force_g);
    };
    CHECK(bench.hold(force));
    bench.run(600);
    Outcome outcome = {0, bench.peak_g / force - 1, 0};
    double sum = 0;
    for (size_t i = 0; i < seen.size(); ++i) {
        sum += seen[i] - (i >= 200 ? seen[i - 200] : 0);
        const bool outside = i >= 199 && std::fabs(sum / 200 / force - 1) > 0.02;
        if (outside) outcome.settle_s = static_cast<double>(i) / 1000;
    }
    for (int trial = 0; trial < trials; ++trial) {
        double total = 0, count = 0;
        bench.each_ms = [&] {
            total += bench.sync.high ? bench.force_g : 0;
            count += bench.sync.high;
        };
        CHECK(bench.command(Command::Run) == Answer::Ok);
        CHECK(bench.finish(20000));
        const double error = std::fabs(total / count / force - 1);
        outcome.worst_mean_error = std::max(outcome.worst_mean_error, error);
        bench.command(Command::Retract);
        CHECK(bench.finish(5000));
        bench.write_wide(reg::move_target, 0);
        bench.command(Command::Move);
        CHECK(bench.finish(8000));
        CHECK(bench.hold(force));
    }
    return outcome;
}

void check(const char *name, const BenchParameters &parameters) {
    for (double force : {250.0, 500.0, 1000.0}) {
        for (double speed : {40.0, 120.0}) {
            const Outcome outcome = measure(parameters, force, speed);
            const bool good = outcome.settle_s < 1 && outcome.overshoot < 0.05 &&
                              outcome.worst_mean_error < 0.01;
            if (!good)
                std::printf("%s, %g g, %g mm/s: settled in %.2f s, overshoot %.1f %%, mean error %.2f %%\n",
                            name, force, speed, outcome.settle_s, 100 * outcome.overshoot,
                            100 * outcome.worst_mean_error);
            CHECK(good);
        }
    }
}

}  // namespace

TEST(force_on_the_nominal_bench) { check("nominal", {}); }

TEST(force_over_the_range_of_stiffness) {
    for (double stiffness : {300.0, 450.0, 750.0, 900.0}) {
        BenchParameters p;
        p.stiffness_g_mm = stiffness;
        check("stiffness", p);
    }
}

TEST(force_over_the_range_of_the_actuator) {
    for (double lag : {15.0, 50.0}) {
        BenchParameters p;
        p.lag_ms = lag;
        check("lag", p);
    }
    for (double band : {0.02, 0.2}) {
        BenchParameters p;
        p.dead_band = band;
        check("dead band", p);
    }
    for (double speed : {6.0, 15.0}) {
        BenchParameters p;
        p.actuator_speed_mm_s = speed;
        check("full speed", p);
    }
    BenchParameters p;
    p.stiction = 0.05;
    check("stiction", p);
}

TEST(force_over_the_range_of_the_drum) {
    for (double phase : {0.0, 1.6, 3.1, 4.7}) {
        BenchParameters p;
        p.run_out_phase = phase;
        check("run-out phase", p);
    }
    BenchParameters round, bent, heavy, light;
    round.run_out_mm = 0;
    check("no run-out", round);
    bent.run_out_mm = 0.1;
    check("run-out", bent);
    heavy.moved_mass_g = 1500;
    check("mass", heavy);
    light.weight_g = 800;
    light.backlash_mm = 0.1;
    check("backlash", light);
}

TEST(force_over_the_range_of_the_contact) {
    BenchParameters stiffening, rippled, noisy;
    stiffening.stiffening_per_mm = 0.3;
    check("stiffening", stiffening);
    rippled.ripple_mm = 0.02;
    check("ripple", rippled);
    noisy.noise_g = 1;
    check("noise", noisy);
}

TEST(an_approach_to_the_stiffest_contact_stays_below_a_tenth_over) {
    for (double contact : {10.0, 17.3, 20.0, 29.9}) {
        for (double stiffening : {0.1, 0.3}) {
            BenchParameters p;
            p.stiffness_g_mm = 900;
            p.stiffening_per_mm = stiffening;
            p.contact_mm = contact;
            p.start_mm = 1;
            for (double force : {50.0, 100.0, 250.0, 500.0, 1000.0}) {
                Bench bench(p);
                CHECK(bench.arm_and_tare());
                CHECK(bench.hold(force, 60000));
                bench.run(500);
                CHECK_NEAR(bench.peak_g, force, 0.1 * force);
            }
        }
    }
}

TEST(a_hundred_trials_do_not_drift) {
    Bench bench;
    CHECK(bench.arm_and_tare());
    bench.write(reg::speed_set, {12000});
    double first = 0, last = 0;
    for (int trial = 0; trial < 100; ++trial) {
        double total = 0, count = 0;
        bench.each_ms = [&] {
            total += bench.sync.high ? bench.force_g : 0;
            count += bench.sync.high;
        };
        CHECK(bench.hold(500));
        bench.command(Command::Run);
        CHECK(bench.finish(10000));
        if (trial < 10) first += total / count / 10;
        if (trial >= 90) last += total / count / 10;
        bench.command(Command::Retract);
        CHECK(bench.finish(5000));
        bench.write_wide(reg::move_target, 0);
        bench.command(Command::Move);
        CHECK(bench.finish(8000));
    }
    CHECK_NEAR(last / first, 1, 0.005);
}
