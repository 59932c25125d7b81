// Force modes, gain proposal, tare by the angle, run-in and optional wires, on the PC's bench.
#include <cmath>

#include "bench.h"
#include "check.h"

namespace {

constexpr uint16_t ALL_SIGNALS = 31;

uint16_t without(Signal signal) { return ALL_SIGNALS & ~(1u << static_cast<int>(signal)); }

bool homed(Bench &bench) {
    return bench.arm_and_tare() && bench.command(Command::Home) == Answer::Ok &&
           bench.finish(15000);
}

}  // namespace

TEST(a_step_test_proposes_gains_for_the_delay_and_stiffness_it_finds) {
    struct Plant {
        double stiffness, lag_ms, force_g;
    };
    for (const Plant &plant : {Plant{600, 30, 500}, Plant{300, 30, 1000}, Plant{900, 30, 250},
                               Plant{600, 15, 500}, Plant{600, 50, 500}}) {
        BenchParameters parameters;
        parameters.stiffness_g_mm = plant.stiffness;
        parameters.lag_ms = plant.lag_ms;
        parameters.stiffening_per_mm = 0;
        Bench bench(parameters);
        CHECK(bench.arm_and_tare());
        CHECK(bench.hold(plant.force_g));
        bench.peak_g = 0;
        CHECK(bench.command(Command::Tune) == Answer::Ok);
        CHECK(bench.finish(3000));
        // Lag, half of what a conversion averages, a period between samples.
        const double delay_ms = plant.lag_ms + 5 + 12.5;
        CHECK_NEAR(bench.read(reg::tuned_delay) * 0.1, delay_ms, 0.3 * delay_ms);
        CHECK_NEAR(bench.read(reg::tuned_stiffness_g_per_mm), plant.stiffness, 0.35 * plant.stiffness);
        CHECK_NEAR(bench.read(reg::proposed_gain_p), 3e6 / (bench.read(reg::tuned_delay) * 10.0), 20);
        CHECK(bench.peak_g < 1.03 * plant.force_g);
        CHECK(bench.state() == State::Hold);
        bench.run(1500);
        CHECK_NEAR(bench.force_g, plant.force_g, 0.03 * plant.force_g);
    }
}

TEST(proposed_gains_hold_the_force) {
    BenchParameters parameters;
    parameters.lag_ms = 50;
    Bench bench(parameters);
    CHECK(bench.arm_and_tare());
    CHECK(bench.hold(500));
    CHECK(bench.command(Command::Tune) == Answer::Ok);
    CHECK(bench.finish(3000));
    bench.write(reg::gain_p, {bench.read(reg::proposed_gain_p), bench.read(reg::proposed_gain_i)});
    CHECK(bench.command(Command::Retract) == Answer::Ok);
    CHECK(bench.finish(3000));
    bench.peak_g = 0;
    CHECK(bench.hold(500, 3000));
    CHECK(bench.peak_g < 525);
    bench.run(1000);
    CHECK_NEAR(bench.force_g, 500, 10);
}

TEST(a_step_test_needs_a_held_force_and_ends_with_it) {
    Bench bench;
    CHECK(bench.command(Command::Tune) == Answer::Refused);
    CHECK(bench.arm_and_tare());
    CHECK(bench.command(Command::Tune) == Answer::Refused);
    CHECK(bench.hold(500));
    CHECK(bench.command(Command::Tune) == Answer::Ok);
    CHECK(bench.command(Command::Run) == Answer::Refused);
    bench.push_g = 2000;
    CHECK(!bench.finish(2000));
    CHECK(bench.result() == CommandResult::Failed);
    CHECK_EQUAL(bench.read(reg::proposed_gain_p), 0);
}

TEST(a_jammed_actuator_answers_no_step_test) {
    Bench bench;
    CHECK(bench.arm_and_tare());
    CHECK(bench.hold(500));
    bench.actuator_jammed = true;
    CHECK(bench.command(Command::Tune) == Answer::Ok);
    CHECK(!bench.finish(3000));
    CHECK_EQUAL(bench.read(reg::proposed_gain_p), 0);
}

TEST(a_tare_over_a_turn_takes_the_imbalance_out) {
    BenchParameters parameters;
    parameters.imbalance_g = 5;
    Bench bench(parameters);
    CHECK(bench.command(Command::TareTurn) == Answer::Refused);
    CHECK(homed(bench));
    CHECK(bench.command(Command::TareTurn) == Answer::Ok);
    CHECK(bench.state() == State::Position);
    CHECK(bench.finish(30000));
    CHECK(bench.read(reg::status_bits) >> static_cast<int>(Status::Tared) & 1);
    CHECK_NEAR(bench.read_wide(reg::tare_counts), 80000, 60);
    for (int32_t place : {0, 1600, 3200, 5000, 9600, 12000}) {
        bench.write_wide(reg::move_target, 3 * 12800 + place);
        bench.command(Command::Move);
        CHECK(bench.finish(20000));
        bench.run(300);
        double sum = 0;
        for (int i = 0; i < 40; ++i) {
            bench.run(13);
            sum += bench.drum.loadcell().force_g() / 40;
        }
        CHECK_NEAR(sum, 0, 0.4);
    }
    // A tare at rest keeps the table and still reads nothing anywhere.
    CHECK(bench.command(Command::Tare) == Answer::Ok);
    CHECK(bench.finish(3000));
    CHECK_NEAR(bench.read_wide(reg::tare_counts), 80000, 200);
}

TEST(a_tare_over_a_turn_that_is_stopped_changes_nothing) {
    Bench bench;
    CHECK(homed(bench));
    const int32_t before = bench.read_wide(reg::tare_counts);
    CHECK(bench.command(Command::TareTurn) == Answer::Ok);
    bench.run(4000);
    CHECK(bench.command(Command::Stop) == Answer::Ok);
    CHECK(bench.finish(5000));
    CHECK_EQUAL(bench.read_wide(reg::tare_counts), before);
    CHECK_EQUAL(bench.read(reg::tare_place_00 + 3), 0);
    bench.write_wide(reg::move_target, 0);
    CHECK(bench.command(Command::Move) == Answer::Ok);
    CHECK(bench.finish(20000));
    CHECK_EQUAL(bench.read(reg::tare_place_00 + 3), 0);
}

TEST(the_run_in_must_hold_the_ramp_and_its_settling) {
    Bench bench;
    CHECK(bench.arm_and_tare());
    CHECK(bench.hold(500));
    bench.write(reg::speed_set, {12000});
    bench.write(reg::run_in_set, {200});  // the ramp takes 12 mm, 100 ms another 12
    CHECK(bench.command(Command::Run) == Answer::Refused);
    bench.write(reg::run_settle_ms, {50});
    CHECK(bench.command(Command::Run) == Answer::Ok);
}

TEST(every_speed_shows_exactly_the_same_steps_of_texture) {
    for (uint16_t speed : {2000, 4000, 6000, 8000, 10000, 12000}) {
        Bench bench;
        CHECK(bench.arm_and_tare());
        CHECK(bench.hold(500));
        bench.write(reg::speed_set, {speed});
        bench.write(reg::travel_set, {2400});
        int32_t opened = 0;
        bench.engine.set_position(0);
        bench.keep_steps = true;
        CHECK(bench.command(Command::Run) == Answer::Ok);
        CHECK(bench.run_until([&] { return bench.sync.high; }, 10000));
        for (uint32_t cycle : bench.step_cycles) opened += cycle / 16 <= bench.sync.rise_us;
        CHECK(bench.finish(20000));
        int32_t inside = 0;
        for (uint32_t cycle : bench.step_cycles)
            inside += cycle / 16 > bench.sync.rise_us && cycle / 16 <= bench.sync.fall_us;
        CHECK_EQUAL(inside, 7680);
    }
}

TEST(each_optional_wire_may_be_missing) {
    for (Signal absent : {Signal::Estop, Signal::Index, Signal::EndSwitches, Signal::Position,
                          Signal::Sync}) {
        Bench bench;
        CHECK(bench.write(reg::optional_signals, {without(absent)}) == Answer::Ok);
        CHECK(bench.arm_and_tare());
        CHECK(bench.hold(500));
        CHECK(bench.command(Command::Run) == Answer::Ok);
        CHECK(bench.finish(20000));
        CHECK(bench.command(Command::Retract) == Answer::Ok);
        CHECK(bench.finish(9000));
        CHECK(bench.state() == State::Armed);
        CHECK_EQUAL(bench.force_g, 0);
    }
}

TEST(with_neither_position_nor_end_switches_a_lift_goes_by_time) {
    for (bool commissioned : {true, false}) {
        Bench bench;
        CHECK(bench.write(reg::optional_signals, {19}) == Answer::Ok);
        if (commissioned) CHECK(bench.commission());
        CHECK(bench.command(Command::Arm) == Answer::Ok);
        bench.run(commissioned ? 5900 : 23900);
        CHECK(bench.state() == State::Retract);
        CHECK(bench.finish(600));
    }
}

TEST(inverted_end_switches_and_potentiometer_are_put_right) {
    Bench bench;
    bench.inverted_ends = bench.inverted_position = true;
    CHECK(bench.write(reg::signal_polarity, {12}) == Answer::Ok);
    bench.run(100);
    CHECK(!(bench.read(reg::status_bits) >> static_cast<int>(Status::EndUp) & 1));
    CHECK_NEAR(bench.read(reg::actuator_position_um), 5000, 50);
    CHECK(bench.arm_and_tare());
    CHECK(bench.hold(500));
    CHECK_NEAR(bench.read(reg::last_contact_um), 20000, 200);
    CHECK(bench.command(Command::Retract) == Answer::Ok);
    CHECK(bench.finish(6000));
    CHECK(bench.write(reg::optional_signals, {without(Signal::Position)}) == Answer::Ok);
    CHECK(bench.command(Command::Retract) == Answer::Ok);
    CHECK(bench.finish(9000));
    CHECK(bench.read(reg::status_bits) >> static_cast<int>(Status::EndUp) & 1);
}

TEST(a_depth_is_held_by_position_on_a_skin_of_any_stiffness) {
    for (double stiffness : {300.0, 900.0}) {
        BenchParameters parameters;
        parameters.stiffness_g_mm = stiffness;
        Bench bench(parameters);
        CHECK(bench.arm_and_tare());
        bench.write(reg::force_mode, {static_cast<uint16_t>(ForceMode::Position)});
        CHECK(bench.command(Command::Approach) == Answer::Ok);
        CHECK(bench.finish(15000));
        const double rod = bench.rod_mm;
        CHECK_NEAR(rod - 20, 1.0, 0.15);
        CHECK(bench.command(Command::Run) == Answer::Ok);
        CHECK(bench.finish(20000));
        CHECK_NEAR(bench.rod_mm, rod, 0.06);
    }
}
