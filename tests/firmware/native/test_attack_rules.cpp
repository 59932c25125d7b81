// What no computer may talk the drum into, on the PC's bench; true force is the bench's own.
#include <cmath>
#include <cstdio>

#include "bench.h"
#include "check.h"

namespace {

Fault fault(const Bench &bench) { return bench.drum.machine().fault(); }

bool shows(Bench &bench, Status status) {
    return bench.read(reg::status_bits) >> static_cast<int>(status) & 1;
}

void held(Bench &bench) {
    CHECK(bench.arm_and_tare());
    CHECK(bench.hold(500));
}

// HOLD at 500 g, the emergency stop pressed and released, the fault cleared.
void stopped_in_contact(Bench &bench) {
    held(bench);
    bench.estop_open = true;
    bench.run(300);
    bench.estop_open = false;
    bench.run(2);
    CHECK(bench.command(Command::Clear) == Answer::Ok);
    CHECK(bench.force_g > 400);
}

struct Change {
    uint16_t address;
    int32_t value;
    bool wide;
};

const Change CHANGES[] = {
    {reg::scale_ug_per_count, 240, true},  {reg::scale_ug_per_count, -2400, true},
    {reg::tare_counts, 288000, true},      {reg::tare_place_00 + 3, 500, false},
    {reg::signal_polarity, 1, false},      {reg::optional_signals, 0, false},
    {reg::over_force, 30000, false},       {reg::force_mode, 2, false},
    {reg::depth_set_um, 10000, false},
};

Answer change(Bench &bench, const Change &change) {
    if (change.wide) return bench.write_wide(change.address, change.value);
    return bench.write(change.address, {static_cast<uint16_t>(change.value)});
}

int32_t standing(Bench &bench, const Change &change) {
    return change.wide ? bench.read_wide(change.address) : bench.read(change.address);
}

void check_refused(Bench &bench) {
    for (const Change &each : CHANGES) {
        const int32_t before = standing(bench, each);
        CHECK(change(bench, each) == Answer::Refused);
        CHECK_EQUAL(standing(bench, each), before);
        CHECK(change(bench, {each.address, before, each.wide}) == Answer::Ok);
    }
}

}  // namespace

TEST(what_decides_a_force_is_refused_in_contact_and_the_same_value_is_not) {
    Bench bench;
    held(bench);
    check_refused(bench);
    CHECK(bench.state() == State::Hold);
    CHECK(bench.command(Command::Run) == Answer::Ok);
    check_refused(bench);
}

TEST(what_decides_a_force_is_refused_where_contact_may_stand_after_a_fault) {
    Bench bench;
    stopped_in_contact(bench);
    CHECK(bench.state() == State::Idle);
    CHECK(shows(bench, Status::ContactMayStand));
    check_refused(bench);
}

TEST(a_lifted_drum_takes_every_setting) {
    for (const Change &each : CHANGES) {
        Bench bench;
        CHECK(bench.arm_and_tare());
        CHECK(change(bench, each) == Answer::Ok);
    }
}

TEST(a_drum_just_booted_takes_its_description_but_no_tare) {
    Bench bench;
    CHECK(shows(bench, Status::ContactMayStand));
    CHECK(bench.write(reg::over_force, {12000}) == Answer::Ok);
    CHECK(bench.write_wide(reg::scale_ug_per_count, -3000) == Answer::Ok);
    CHECK(bench.write_wide(reg::tare_counts, 80000) == Answer::Refused);
    CHECK(bench.command(Command::Tare) == Answer::Refused);
}

TEST(no_scale_outside_the_band_is_taken_anywhere) {
    Bench bench;
    for (int32_t scale : {0, 1, -1, 199, -199, 25001, -25001, 1000000})
        CHECK(bench.write_wide(reg::scale_ug_per_count, scale) == Answer::OutOfRange);
    for (int32_t scale : {200, -200, 25000, -25000, 2400})
        CHECK(bench.write_wide(reg::scale_ug_per_count, scale) == Answer::Ok);
}

TEST(a_held_emergency_stop_cannot_be_configured_away) {
    for (bool at_boot : {false, true}) {
        Bench bench;
        if (!at_boot) CHECK(bench.arm_and_tare());
        bench.estop_open = true;
        bench.run(2);
        for (uint16_t address : {reg::signal_polarity, reg::optional_signals})
            CHECK(bench.write(address, {address == reg::signal_polarity}) == Answer::Refused);
        CHECK(bench.command(Command::Defaults) == Answer::Refused);
        CHECK(bench.command(Command::Clear) == Answer::Refused);
        CHECK(bench.command(Command::Arm) == Answer::Refused);
        CHECK(bench.state() == State::FaultOff);
    }
}

TEST(a_guarded_setting_and_a_command_do_not_come_in_one_request) {
    Bench bench;
    CHECK(bench.arm_and_tare());
    const auto approach = static_cast<uint16_t>(Command::Approach);
    CHECK(bench.write(reg::command, {approach, 999, 4}) == Answer::Refused);
    CHECK(bench.state() == State::Armed);
    CHECK_EQUAL(bench.read(reg::signal_polarity), 0);
}

TEST(a_wrong_scale_that_was_set_lifted_ends_at_the_boards_own_limit) {
    for (int32_t scale : {200, 240, -2400}) {
        Bench bench;
        CHECK(bench.arm_and_tare());
        CHECK(bench.write_wide(reg::scale_ug_per_count, scale) == Answer::Ok);
        CHECK(bench.write(reg::over_force, {30000}) == Answer::Ok);
        bench.write(reg::force_set, {15000});
        CHECK(bench.commission());
        bench.command(Command::Approach);
        bench.finish(15000);
        // With the wrong sign, pressing reads as pulling.
        if (scale < 0) CHECK(fault(bench) == Fault::ForceUnexplained);
        else CHECK(fault(bench) == Fault::OverForce || fault(bench) == Fault::NoContact);
        CHECK(bench.peak_g < (scale < 0 ? 300 : 2300));
        bench.run(1500);
        CHECK_EQUAL(bench.force_g, 0);
    }
}

// Over all skins and actuators that are plausible, true force stays below the limit and what the
// board says that it overruns; an actuator that is faster than believed overruns as much more.
TEST(a_depth_ends_at_the_boards_own_limit_and_overruns_it_by_what_the_board_says) {
    struct Plant {
        double stiffness, stiffening, speed_mm_s;
    };
    for (const Plant &plant : {Plant{600, 0.1, 10}, Plant{300, 0, 6}, Plant{900, 0.3, 10},
                               Plant{900, 0.3, 15}, Plant{900, 0, 15}}) {
        BenchParameters parameters;
        parameters.stiffness_g_mm = plant.stiffness;
        parameters.stiffening_per_mm = plant.stiffening;
        parameters.actuator_speed_mm_s = plant.speed_mm_s;
        Bench bench(parameters);
        CHECK(bench.arm_and_tare());
        CHECK(bench.write(reg::over_force, {30000}) == Answer::Ok);
        CHECK(bench.write(reg::force_mode, {2}) == Answer::Ok);
        CHECK(bench.write(reg::depth_set_um, {10000}) == Answer::Ok);
        CHECK(!bench.hold(1500));
        CHECK(fault(bench) == Fault::OverForce);
        const double most = bench.read(reg::most_force);
        const double travel_mm = bench.read(reg::overrun_um) * 1e-3 * plant.speed_mm_s / 10;
        const double slope =
            std::sqrt(plant.stiffness * (plant.stiffness + 4 * plant.stiffening * most));
        const double overshoot =
            travel_mm * slope + plant.stiffness * plant.stiffening * travel_mm * travel_mm;
        CHECK(bench.peak_g > 0.95 * most);
        CHECK(bench.peak_g < most + overshoot);
        std::printf("     %.0f g/mm, %.1f/mm, %.0f mm/s: peak %.0f g, at most %.0f g\n",
                    plant.stiffness, plant.stiffening, plant.speed_mm_s, bench.peak_g,
                    most + overshoot);
    }
}

TEST(a_tare_far_from_the_zero_makes_no_force) {
    Bench bench;
    CHECK(bench.arm_and_tare());
    CHECK(bench.write_wide(reg::tare_counts, 80000 + 250000) == Answer::Ok);
    CHECK(bench.command(Command::Approach) == Answer::Refused);
    CHECK(bench.command(Command::Tare) == Answer::Ok);
    CHECK(bench.finish(2000));
    CHECK(bench.command(Command::Approach) == Answer::Ok);
}

TEST(an_approach_needs_a_tare) {
    Bench bench;
    CHECK(bench.command(Command::Arm) == Answer::Ok);
    CHECK(bench.finish(8000));
    CHECK(bench.command(Command::Approach) == Answer::Refused);
}

TEST(a_tare_in_contact_is_refused_unless_asked_for_by_name) {
    Bench bench;
    stopped_in_contact(bench);
    const int32_t before = bench.read_wide(reg::tare_counts);
    CHECK(bench.command(Command::Tare) == Answer::Refused);
    CHECK(bench.command(Command::TareAnyway) == Answer::Ok);
    CHECK(bench.finish(2000));
    CHECK(bench.read_wide(reg::tare_counts) - before > 150000);
    // The board's own zero stays where it was, so that no such force is approached.
    CHECK(bench.command(Command::Arm) == Answer::Ok);
    CHECK(bench.finish(8000));
    CHECK_EQUAL(bench.force_g, 0);
    CHECK(!shows(bench, Status::ContactMayStand));
    CHECK(bench.command(Command::Approach) == Answer::Refused);
    CHECK(bench.command(Command::Tare) == Answer::Ok);
    CHECK(bench.finish(2000));
    CHECK(bench.command(Command::Disarm) == Answer::Ok);
    bench.touch_cell();
    CHECK(bench.command(Command::Arm) == Answer::Ok);
    CHECK(bench.finish(2000));
    CHECK(bench.hold(500));
    CHECK(bench.peak_g < 550);
}

TEST(another_drum_is_tared_by_name) {
    Bench bench;
    CHECK(bench.arm_and_tare());
    bench.push_g = 400;
    bench.run(200);
    CHECK(bench.command(Command::Tare) == Answer::Refused);
    CHECK(bench.command(Command::TareAnyway) == Answer::Ok);
    CHECK(bench.finish(2000));
    CHECK_NEAR(bench.read_wide(reg::tare_counts), 80000 + 166667, 200);
    CHECK(bench.command(Command::Disarm) == Answer::Ok);
    bench.touch_cell();
    CHECK(bench.command(Command::Arm) == Answer::Ok);
    CHECK(bench.finish(2000));
    CHECK(bench.hold(500));
    CHECK_NEAR(bench.force_g, 500, 30);
}

TEST(a_boot_in_contact_learns_no_zero_before_it_lifted) {
    BenchParameters parameters;
    parameters.start_mm = 20.8;
    Bench bench(parameters);
    CHECK(bench.force_g > 400);
    CHECK(bench.command(Command::Tare) == Answer::Refused);
    CHECK(bench.command(Command::Arm) == Answer::Ok);
    CHECK(bench.finish(12000));
    CHECK_EQUAL(bench.force_g, 0);
    CHECK(bench.command(Command::Tare) == Answer::Ok);
    CHECK(bench.finish(2000));
    CHECK_NEAR(bench.read_wide(reg::tare_counts), 80000, 200);
}

TEST(a_change_of_the_wires_of_a_lift_leaves_nothing_known) {
    Bench bench;
    CHECK(bench.arm_and_tare());
    CHECK(bench.write(reg::optional_signals, {31 & ~4}) == Answer::Ok);
    CHECK(shows(bench, Status::ContactMayStand));
    CHECK(bench.command(Command::Approach) == Answer::Refused);
    CHECK(bench.command(Command::Tare) == Answer::Refused);
    CHECK(bench.command(Command::Retract) == Answer::Ok);
    CHECK(bench.finish(8000));
    CHECK(bench.commission());
    CHECK(bench.hold(500));
}

TEST(a_fault_lifts_until_contact_is_gone) {
    BenchParameters parameters;
    parameters.actuator_speed_mm_s = 2;  // tired: 700 ms are 1.3 mm
    parameters.contact_mm = 2;
    parameters.start_mm = 0;
    Bench bench(parameters);
    CHECK(bench.arm_and_tare());
    CHECK(bench.hold(1000, 60000));
    bench.beating = false;
    bench.run(250 + 750);
    CHECK(bench.state() == State::FaultLift);
    CHECK(bench.run_until([&] { return bench.state() == State::FaultOff; }, 9000));
    CHECK_EQUAL(bench.force_g, 0);
    CHECK(!shows(bench, Status::LiftFailed));
    CHECK(!shows(bench, Status::ContactMayStand));
}

TEST(a_lift_that_cannot_ends_and_says_so) {
    Bench bench;
    held(bench);
    bench.actuator_jammed = true;
    bench.beating = false;
    CHECK(bench.run_until([&] { return bench.state() == State::FaultOff; }, 9000));
    CHECK(bench.force_g > 400);
    CHECK(shows(bench, Status::LiftFailed));
    CHECK(shows(bench, Status::ContactMayStand));
    bench.actuator_jammed = false;
    bench.beating = true;
    bench.run(40);
    CHECK(bench.command(Command::Clear) == Answer::Ok);
    CHECK(shows(bench, Status::ContactMayStand));
    CHECK(bench.command(Command::Arm) == Answer::Ok);
    CHECK(bench.finish(9000));
    CHECK_EQUAL(bench.force_g, 0);
    CHECK(!shows(bench, Status::LiftFailed));
}

TEST(a_saturated_cell_lifts_until_the_travel_says_that_contact_is_gone) {
    Bench bench;
    held(bench);
    bench.loadcell_saturated = true;
    CHECK(bench.run_until([&] { return bench.state() == State::FaultOff; }, 9000));
    CHECK(bench.force_g == 0);
    CHECK(!shows(bench, Status::ContactMayStand));
}

TEST(a_cell_whose_bridge_is_far_off_is_armed_and_tared) {
    BenchParameters parameters;
    parameters.offset_counts = 900000;  // 2,160 g by its settings, before anybody tared
    Bench bench(parameters);
    CHECK(bench.state() == State::Idle);
    CHECK(bench.arm_and_tare());
    CHECK(bench.hold(500));
    CHECK_NEAR(bench.force_g, 500, 30);
}
