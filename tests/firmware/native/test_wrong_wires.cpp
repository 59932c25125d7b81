// What wrong, broken and swapped wires of the actuator may do at most; true force is the bench's own.
#include <cstdio>

#include "bench.h"
#include "check.h"
#include "variant.h"

namespace {

Fault fault(const Bench &bench) { return bench.drum.machine().fault(); }

bool known(Bench &bench) {
    return bench.read(reg::status_bits) >> static_cast<int>(Status::DirectionKnown) & 1;
}

constexpr uint16_t without(Signal signal) { return 31 & ~(1 << static_cast<int>(signal)); }

// The stiffest contact, a hair below the drum.
BenchParameters close_and_stiff() {
    BenchParameters parameters;
    parameters.stiffness_g_mm = 900;
    parameters.run_out_mm = 0;
    parameters.start_mm = parameters.contact_mm - 0.05;
    return parameters;
}

void arm_again(Bench &bench, int times) {
    for (int i = 0; i < times; ++i) {
        bench.command(Command::Clear);
        bench.command(Command::Arm);
        bench.run(2500);
    }
}

}  // namespace

TEST(a_swapped_actuator_moves_a_little_and_is_named) {
    Bench bench;
    bench.swapped_actuator = true;
    CHECK(bench.command(Command::Arm) == Answer::Ok);
    bench.run(3000);
    CHECK(bench.state() == State::FaultOff);
    CHECK(fault(bench) == Fault::ActuatorReversed);
    CHECK(!bench.bridge_on);
    CHECK(bench.rod_mm > 5 && bench.rod_mm < 5.4);
    CHECK(!known(bench));
}

TEST(a_swapped_actuator_in_contact_never_presses_with_300_g) {
    for (bool position : {true, false}) {
        Bench bench(close_and_stiff());
        if (!position) CHECK(bench.write(reg::optional_signals, {without(Signal::Position)}) == Answer::Ok);
        bench.swapped_actuator = true;
        CHECK(bench.command(Command::Arm) == Answer::Ok);
        bench.run(3000);
        const double first_g = bench.peak_g;
        CHECK(bench.state() == State::FaultOff);
        CHECK(fault(bench) == (position ? Fault::ActuatorReversed : Fault::ForceUnexplained));
        if (!position) arm_again(bench, 3);
        CHECK(bench.peak_g < 300);
        std::printf("     swapped, %s potentiometer: %.0f g, then %.0f g\n",
                    position ? "with" : "without", first_g, bench.peak_g);
    }
}

TEST(a_swapped_actuator_with_end_switches_alone_stops_at_the_wrong_end) {
    BenchParameters parameters;
    parameters.start_mm = 40;
    parameters.contact_mm = 100;
    Bench bench(parameters);
    CHECK(bench.write(reg::optional_signals, {without(Signal::Position)}) == Answer::Ok);
    bench.swapped_actuator = true;
    CHECK(bench.command(Command::Arm) == Answer::Ok);
    bench.run(8000);
    CHECK(fault(bench) == Fault::ActuatorReversed);
    CHECK(!bench.bridge_on);
}

TEST(swapped_end_switches_stop_a_lift_at_the_top) {
    Bench bench;
    CHECK(bench.write(reg::optional_signals, {without(Signal::Position)}) == Answer::Ok);
    bench.swapped_ends = true;
    CHECK(bench.command(Command::Arm) == Answer::Ok);
    bench.run(4000);
    CHECK(fault(bench) == Fault::ActuatorReversed);
}

TEST(a_jammed_actuator_is_off_within_a_second) {
    Bench bench;
    bench.actuator_jammed = true;
    CHECK(bench.command(Command::Arm) == Answer::Ok);
    bench.run(1000);
    CHECK(bench.state() == State::FaultOff);
    CHECK(fault(bench) == Fault::ActuatorStuck);
}

TEST(the_first_motion_is_a_ramp_and_later_ones_are_not) {
    Bench bench;
    int16_t least_before = 0;
    bench.each_ms = [&] {
        if (bench.rod_mm > 4.9 && bench.drive_permille < least_before) least_before = bench.drive_permille;
    };
    CHECK(bench.arm_and_tare());
    CHECK(known(bench));
    CHECK(least_before > -450);
    CHECK(bench.hold(500));
    bench.each_ms = nullptr;
    CHECK(bench.command(Command::Retract) == Answer::Ok);
    bench.run(2);
    CHECK_EQUAL(bench.drive_permille, -1000);
}

TEST(wires_swapped_in_contact_end_the_lift_at_once) {
    Bench bench(close_and_stiff());
    CHECK(bench.arm_and_tare());
    CHECK(bench.hold(500));
    bench.swapped_actuator = true;
    CHECK(bench.command(Command::Retract) == Answer::Ok);
    bench.run(3000);
    CHECK(fault(bench) == Fault::ActuatorReversed);
    // 0.1 mm, what a pulse may coast, and what full speed travels until the potentiometer has shown
    // it and the rod stands.
    CHECK(bench.peak_g < 500 + 900 * (0.25 + 10 * (0.010 + board::ACTUATOR_LAG_S)));
    std::printf("     swapped at 500 g: %.0f g\n", bench.peak_g);
}

TEST(a_tired_actuator_with_a_wide_dead_band_is_no_fault) {
    BenchParameters parameters;
    parameters.actuator_speed_mm_s = 2;
    parameters.dead_band = 0.25;
    parameters.stiction = 0.1;
    parameters.contact_mm = 8;
    Bench bench(parameters);
    CHECK(bench.arm_and_tare());
    CHECK(bench.command(Command::Retract) == Answer::Ok);
    CHECK(bench.finish(8000));
    bench.write(reg::force_set, {5000});
    CHECK(bench.command(Command::Approach) == Answer::Ok);
    bench.run(15000);
    CHECK(fault(bench) != Fault::ActuatorStuck && fault(bench) != Fault::ActuatorReversed);
    CHECK(bench.command(Command::Stop) == Answer::Ok || fault(bench) != Fault::None);
    bench.run(8000);
    CHECK_EQUAL(bench.force_g, 0);
}

TEST(a_nudge_reports_its_way_and_ends_in_idle) {
    for (bool presses : {false, true}) {
        for (bool swapped : {false, true}) {
            Bench bench;
            bench.swapped_actuator = swapped;
            bench.write(reg::nudge_direction, {presses});
            CHECK(bench.command(Command::Nudge) == Answer::Ok);
            CHECK(bench.finish(2500));
            CHECK(bench.state() == State::Idle);
            CHECK(!bench.bridge_on);
            const int16_t travel_um = static_cast<int16_t>(bench.read(reg::nudge_travel_um));
            CHECK_EQUAL(travel_um > 0, presses != swapped);
            CHECK_NEAR(std::fabs(travel_um), 110, 15);
            CHECK_EQUAL(known(bench), !swapped);
            CHECK(std::fabs(bench.rod_mm - 5) < 0.3);
        }
    }
}

// --- the potentiometer's wires ------------------------------------------------------------------

TEST(a_broken_potentiometer_is_never_the_top) {
    for (int reading : {0, 1023}) {
        Bench bench;
        CHECK(bench.arm_and_tare());
        CHECK(bench.hold(500));
        bench.broken_position = reading;
        bench.run(40);
        CHECK(fault(bench) == Fault::PositionWire);
        CHECK(bench.state() == State::FaultLift);
        bench.run(9000);
        CHECK(bench.state() == State::FaultOff);
        CHECK_EQUAL(bench.force_g, 0);
        CHECK(bench.peak_g < 550);
    }
}

TEST(a_lift_does_not_end_while_the_cell_feels_contact) {
    Bench bench;
    CHECK(bench.arm_and_tare());
    CHECK(bench.hold(500));
    // A short to the wiper's upper end through the resistor reads as the top.
    CHECK(bench.command(Command::Retract) == Answer::Ok);
    bench.run(1);
    bench.broken_position = board::POSITION_TOP_RAW;
    bench.run(30);
    CHECK(bench.state() != State::Armed);
    CHECK(bench.command(Command::Move) == Answer::Refused);
    bench.run(9000);
    CHECK_EQUAL(bench.force_g, 0);
}

TEST(a_boot_in_contact_with_a_broken_potentiometer_learns_no_zero) {
    BenchParameters parameters;
    parameters.start_mm = 20.8;
    for (int reading : {0, 1023}) {
        Bench bench(parameters);
        bench.broken_position = reading;
        bench.run(100);
        CHECK(bench.state() == State::Idle);
        CHECK(bench.force_g > 400);
        CHECK(bench.command(Command::Arm) == Answer::Ok);
        bench.run(60);
        CHECK(fault(bench) == Fault::PositionWire);
        CHECK(!bench.drum.machine().accepts(Event::Approach));
        bench.run(9000);
        CHECK(bench.state() == State::FaultOff);
        CHECK_EQUAL(bench.force_g, 0);
        // Without the potentiometer among the fitted wires the rig goes on.
        CHECK(bench.command(Command::Clear) == Answer::Ok);
        CHECK(bench.write(reg::optional_signals, {without(Signal::Position)}) == Answer::Ok);
        CHECK(bench.arm_and_tare());
        CHECK_NEAR(bench.read_wide(reg::tare_counts), 80000, 300);
    }
}

TEST(over_force_lifts_with_a_broken_potentiometer) {
    Bench bench;
    CHECK(bench.arm_and_tare());
    CHECK(bench.hold(500));
    bench.each_ms = [&] { if (bench.state() == State::FaultLift) bench.broken_position = 0; };
    bench.push_g = 2500;
    bench.run(60);
    bench.push_g = 0;
    bench.run(9000);
    CHECK(fault(bench) == Fault::OverForce);
    CHECK_EQUAL(bench.force_g, 0);
}
