// The whole controller on the bench: what it does when it is told to, and when things go wrong.
#include "bench.h"
#include "check.h"

namespace {

Fault fault(const Bench &bench) { return bench.drum.machine().fault(); }

// A drum in each state that a person can leave it in.
void bring(Bench &bench, State state) {
    if (state == State::Idle) return;
    CHECK(bench.arm_and_tare());
    if (state == State::Armed) return;
    if (state == State::Position) {
        bench.write_wide(reg::move_target, 100000);
        CHECK(bench.command(Command::Move) == Answer::Ok);
        bench.run(300);
    } else if (state == State::Approach) {
        CHECK(bench.command(Command::Approach) == Answer::Ok);
        bench.run(300);
    } else {
        CHECK(bench.hold(500));
        if (state == State::Run) CHECK(bench.command(Command::Run) == Answer::Ok);
        if (state == State::Retract) CHECK(bench.command(Command::Retract) == Answer::Ok);
        bench.run(state == State::Retract ? 20 : 300);
    }
    CHECK(bench.state() == state);
}

const State LIVE[] = {State::Idle, State::Armed, State::Position, State::Approach,
                      State::Hold, State::Run,   State::Retract};
const State DRIVEN[] = {State::Armed, State::Position, State::Approach,
                        State::Hold,  State::Run,      State::Retract};

void check_off(const Bench &bench) {
    CHECK(bench.state() == State::FaultOff);
    CHECK(!bench.stepper_on);
    CHECK(!bench.bridge_on);
    CHECK_EQUAL(bench.drive_permille, 0);
    CHECK(!bench.engine.moving());
}

}  // namespace

TEST(it_boots_into_idle_with_everything_off) {
    Bench bench;
    CHECK(bench.state() == State::Idle);
    CHECK(!bench.stepper_on);
    CHECK(!bench.bridge_on);
    CHECK_EQUAL(bench.read(reg::magic), MAGIC);
    CHECK_EQUAL(bench.read(reg::loadcell_sequence), bench.drum.loadcell().sequence());
}

TEST(a_dead_load_cell_fails_the_self_test) {
    BenchParameters parameters;
    parameters.conversion_us = 1e9;
    Bench bench(parameters);
    bench.run(500);
    check_off(bench);
    CHECK(fault(bench) == Fault::Selftest);
    CHECK(bench.command(Command::Clear) == Answer::Refused);
}

TEST(arming_lifts_to_the_upper_end_while_no_contact_is_known) {
    Bench bench;
    CHECK(bench.command(Command::Arm) == Answer::Ok);
    CHECK(bench.state() == State::Retract);
    CHECK(bench.result() == CommandResult::Running);
    CHECK(bench.finish(3000));
    CHECK(bench.state() == State::Armed);
    CHECK(bench.rod_mm < 0.5);
}

TEST(tare_makes_the_lifted_drum_weigh_nothing) {
    Bench bench;
    CHECK(bench.arm_and_tare());
    CHECK_NEAR(bench.drum.loadcell().force_g(), 0, 1.2);
    CHECK_NEAR(bench.read_wide(reg::tare_counts), 80000, 60);
    CHECK(bench.read(reg::status_bits) >> static_cast<int>(Status::Tared) & 1);
}

TEST(commands_are_refused_as_the_table_says) {
    const Command commands[] = {Command::Arm, Command::Disarm, Command::Move, Command::Approach,
                                Command::Run, Command::Retract, Command::Clear, Command::Tare,
                                Command::Save, Command::Home};
    const Event events[] = {Event::Arm, Event::Disarm, Event::Move, Event::Approach,
                            Event::Run, Event::Retract, Event::Clear};
    for (State state : LIVE) {
        for (uint8_t i = 0; i < sizeof commands; ++i) {
            Bench bench;
            bring(bench, state);
            const bool resting = state == State::Idle || state == State::Armed;
            bool accepted = i >= 7 ? resting : bench.drum.machine().accepts(events[i]);
            // After a boot nobody knows whether the drum is lifted.
            if (commands[i] == Command::Home || commands[i] == Command::Tare)
                accepted = state == State::Armed;
            const uint16_t seen = bench.read(reg::command_acknowledged);
            CHECK(bench.command(commands[i]) == (accepted ? Answer::Ok : Answer::Refused));
            if (!accepted) {
                CHECK(bench.state() == state);
                CHECK_EQUAL(bench.read(reg::command_acknowledged), seen);
            }
        }
    }
}

TEST(a_move_ends_on_its_step) {
    Bench bench;
    CHECK(bench.arm_and_tare());
    for (int32_t target : {1, -1, 3200, 12800, -7001, 0}) {
        bench.write_wide(reg::move_target, target);
        CHECK(bench.command(Command::Move) == Answer::Ok);
        CHECK(bench.finish(20000));
        CHECK_EQUAL(bench.read_wide(reg::steps), target);
        CHECK(bench.state() == State::Armed);
    }
}

TEST(homing_puts_zero_on_the_mark) {
    Bench bench;
    CHECK(bench.arm_and_tare());
    bench.write_wide(reg::move_target, 5000);
    bench.command(Command::Move);
    bench.finish(10000);
    CHECK(bench.command(Command::Home) == Answer::Ok);
    CHECK(bench.finish(15000));
    CHECK(bench.read(reg::status_bits) >> static_cast<int>(Status::Homed) & 1);
    bench.write_wide(reg::move_target, 12800 * 2 + 500);
    bench.command(Command::Move);
    CHECK(bench.finish(15000));
    CHECK_EQUAL(bench.read(reg::index_error_steps), 0);
    CHECK_NEAR(bench.drum_mm, 400 * 3 + 500 * 0.03125, 0.001);
}

TEST(homing_without_a_mark_fails_and_says_so) {
    Bench bench;
    CHECK(bench.arm_and_tare());
    bench.mark_hidden = true;
    CHECK(bench.command(Command::Home) == Answer::Ok);
    CHECK(!bench.finish(15000));
    CHECK(bench.result() == CommandResult::Failed);
    CHECK(bench.state() == State::Armed);
}

TEST(a_mark_that_does_not_come_is_a_slipped_drum) {
    Bench bench;
    CHECK(bench.arm_and_tare());
    bench.command(Command::Home);
    CHECK(bench.finish(15000));
    bench.mark_hidden = true;
    bench.write_wide(reg::move_target, 30000);
    bench.command(Command::Move);
    CHECK(!bench.finish(15000));
    CHECK(fault(bench) == Fault::StepCount);
}

TEST(a_run_opens_the_window_for_exactly_the_travel) {
    for (uint16_t speed : {4000, 8000, 12000}) {
        Bench bench;
        CHECK(bench.arm_and_tare());
        CHECK(bench.hold(500));
        bench.write(reg::speed_set, {speed});
        const double from = bench.drum_mm;
        double opened = 0, closed = 0;
        bool was = false;
        bench.each_ms = [&] {
            if (bench.sync.high && !was) opened = bench.drum_mm - from;
            if (!bench.sync.high && was) closed = bench.drum_mm - from;
            was = bench.sync.high;
        };
        CHECK(bench.command(Command::Run) == Answer::Ok);
        CHECK(bench.finish(20000));
        CHECK(bench.state() == State::Hold);
        CHECK_NEAR(opened, 100, 0.13);
        CHECK_NEAR(closed, 345, 0.13);
        CHECK_EQUAL(bench.sync.count, 1);
        const double seconds = (bench.sync.fall_us - bench.sync.rise_us) * 1e-6;
        CHECK_NEAR(seconds * speed * 0.01, 245, 0.02);
    }
}

TEST(a_run_whose_ramp_is_longer_than_its_run_in_is_refused) {
    Bench bench;
    CHECK(bench.arm_and_tare());
    CHECK(bench.hold(500));
    bench.write(reg::acceleration_set, {50});
    bench.write(reg::speed_set, {12000});
    CHECK(bench.command(Command::Run) == Answer::Refused);
    CHECK(bench.state() == State::Hold);
}

TEST(stop_ramps_down_and_lifts_from_every_state) {
    for (State state : DRIVEN) {
        Bench bench;
        bring(bench, state);
        CHECK(bench.command(Command::Stop) == Answer::Ok);
        CHECK(bench.run_until([&] { return bench.state() == State::Armed; }, 3000));
        bench.run(200);
        CHECK_EQUAL(bench.force_g, 0);
        CHECK(!bench.engine.moving());
        CHECK(!bench.sync.high);
    }
}

TEST(the_emergency_stop_switches_off_in_every_state) {
    for (State state : LIVE) {
        Bench bench;
        bring(bench, state);
        bench.estop_open = true;
        bench.run(1);
        check_off(bench);
        CHECK(fault(bench) == Fault::Estop);
        CHECK(bench.command(Command::Clear) == Answer::Refused);
        bench.estop_open = false;
        bench.run(1);
        CHECK(bench.command(Command::Clear) == Answer::Ok);
        CHECK(bench.state() == State::Idle);
    }
}

TEST(an_absent_emergency_stop_is_not_watched) {
    Bench bench;
    CHECK(bench.write(reg::optional_signals, {14}) == Answer::Ok);
    bench.estop_open = true;
    bench.run(10);
    CHECK(bench.state() == State::Idle);
    CHECK(bench.command(Command::Arm) == Answer::Ok);
}

TEST(over_force_lifts_with_the_second_sample_that_shows_it) {
    for (State state : DRIVEN) {
        Bench bench;
        bring(bench, state);
        const auto above = [&] { return bench.drum.loadcell().measured_g() > 1400; };
        bench.push_g = 1600 - bench.drum.loadcell().measured_g();
        CHECK(bench.run_until(above, 40));
        CHECK(bench.state() == state);
        const uint16_t first = bench.drum.loadcell().sequence();
        CHECK(bench.run_until([&] { return bench.drum.loadcell().sequence() != first; }, 14));
        CHECK(bench.state() == State::FaultLift);
        CHECK_EQUAL(bench.drive_permille, bench.rod_mm < 0.4 ? 0 : -1000);
        CHECK(fault(bench) == Fault::OverForce);
        bench.push_g = 0;
        bench.run(800);
        check_off(bench);
        CHECK_EQUAL(bench.force_g, 0);
    }
}

TEST(each_way_a_load_cell_fails_is_a_fault) {
    struct Way {
        bool Bench::*wire;
        Fault fault;
        int within_ms;
    };
    const Way ways[] = {{&Bench::loadcell_silent, Fault::LoadcellSilent, 45},
                        {&Bench::loadcell_saturated, Fault::LoadcellSaturated, 15},
                        {&Bench::loadcell_frozen, Fault::LoadcellFrozen, 130},
                        {&Bench::out_of_step, Fault::LoadcellDesync, 15}};
    for (State state : DRIVEN) {
        for (const Way &way : ways) {
            Bench bench;
            bring(bench, state);
            bench.*way.wire = true;
            CHECK(bench.run_until([&] { return bench.state() == State::FaultLift; }, way.within_ms));
            // A saturated reading is over any limit too; the first cause is what counts.
            CHECK(fault(bench) == way.fault || fault(bench) == Fault::OverForce);
            bench.run(800);
            check_off(bench);
        }
    }
}

TEST(silence_of_the_computer_lifts_at_250_ms_and_switches_off_within_a_second) {
    for (State state : DRIVEN) {
        if (state == State::Retract) continue;
        Bench bench;
        bring(bench, state);
        bench.run(20 - bench.time_ms % 20);
        bench.beating = false;
        bench.run(248);
        CHECK(bench.state() == state);
        bench.run(4);
        CHECK(bench.state() == State::FaultLift);
        CHECK(fault(bench) == Fault::Heartbeat);
        bench.run(748);
        check_off(bench);
        CHECK_EQUAL(bench.force_g, 0);
        CHECK(bench.command(Command::Clear) == Answer::Refused);
        bench.beating = true;
        bench.run(25);
        CHECK(bench.command(Command::Clear) == Answer::Ok);
    }
}

TEST(a_repeated_heartbeat_value_keeps_nothing_alive) {
    Bench bench;
    CHECK(bench.arm_and_tare());
    bench.beating = false;
    for (int i = 0; i < 30; ++i) {
        bench.write(reg::heartbeat, {7});
        bench.run(10);
    }
    CHECK(fault(bench) == Fault::Heartbeat);
}

TEST(idle_needs_no_heartbeat) {
    Bench bench;
    bench.beating = false;
    bench.run(2000);
    CHECK(bench.state() == State::Idle);
}

TEST(no_contact_within_the_travel_is_a_fault) {
    BenchParameters parameters;
    parameters.contact_mm = 45;
    Bench bench(parameters);
    CHECK(bench.arm_and_tare());
    bench.write(reg::approach_limit_um, {20000});
    CHECK(!bench.hold(500));
    CHECK(fault(bench) == Fault::NoContact);
    CHECK_NEAR(bench.rod_mm, 15, 7);
}

TEST(an_actuator_that_does_not_move_is_a_fault_in_time) {
    Bench bench;
    CHECK(bench.arm_and_tare());
    bench.actuator_jammed = true;
    CHECK(!bench.hold(500, 30000));
    CHECK(fault(bench) == Fault::NoContact);
}

TEST(the_lower_end_is_a_fault) {
    BenchParameters parameters;
    parameters.contact_mm = 60;
    Bench bench(parameters);
    CHECK(bench.arm_and_tare());
    bench.write(reg::approach_limit_um, {50000});
    CHECK(!bench.hold(500, 30000));
    CHECK(fault(bench) == Fault::ActuatorEnd);
    check_off(bench);
}

TEST(a_force_that_never_settles_is_a_fault) {
    Bench bench;
    CHECK(bench.arm_and_tare());
    bench.p.noise_g = 40;
    CHECK(!bench.hold(250));
    CHECK(fault(bench) == Fault::ForceUnreached);
}

TEST(a_set_force_near_the_limit_is_refused) {
    Bench bench;
    CHECK(bench.arm_and_tare());
    bench.write(reg::force_set, {13000});
    CHECK(bench.command(Command::Approach) == Answer::Refused);
    CHECK(bench.state() == State::Armed);
}

TEST(a_lock_rests_the_actuator_once_the_force_is_reached) {
    Bench bench;
    CHECK(bench.arm_and_tare());
    bench.write(reg::force_mode, {static_cast<uint16_t>(ForceMode::Lock)});
    CHECK(bench.hold(500));
    bench.run(100);
    const double rod = bench.rod_mm;
    CHECK(bench.command(Command::Run) == Answer::Ok);
    CHECK(bench.finish(20000));
    CHECK_NEAR(bench.rod_mm, rod, 1e-3);
}

TEST(a_position_holds_the_depth_below_contact) {
    Bench bench;
    CHECK(bench.arm_and_tare());
    bench.write(reg::force_mode, {static_cast<uint16_t>(ForceMode::Position)});
    bench.write(reg::depth_set_um, {800});
    CHECK(bench.command(Command::Approach) == Answer::Ok);
    CHECK(bench.finish(15000));
    bench.run(500);
    CHECK_NEAR(bench.rod_mm - (20 - 0.025 - 0.05 * std::sin(0.7)), 0.8, 0.06);
}

TEST(defaults_restore_what_was_set) {
    Bench bench;
    bench.write(reg::speed_set, {4321});
    CHECK(bench.command(Command::Defaults) == Answer::Ok);
    CHECK_EQUAL(bench.read(reg::speed_set), 8000);
    CHECK(bench.command(Command::Save) == Answer::Ok);
    CHECK(bench.finish(100));
}

TEST(a_watchdog_reset_is_reported_as_a_hang) {
    Bench bench;
    Drum drum;
    drum.boot(true);
    CHECK(drum.machine().fault() == Fault::Hang);
    CHECK(drum.machine().state() == State::FaultOff);
}

TEST(the_ring_and_the_poll_show_the_same_samples) {
    Bench bench;
    bench.run(2000);
    const uint16_t newest = bench.read(reg::loadcell_sequence);
    for (uint16_t age = 0; age < LOADCELL_RECENT; ++age) {
        const uint16_t place = static_cast<uint16_t>(newest - age) % RING_DEPTH;
        const int32_t recent = bench.read_wide(reg::loadcell_recent + 2 * age);
        CHECK_EQUAL(bench.read_wide(reg::ring_raw + 2 * place), recent);
    }
    CHECK_EQUAL(bench.read_wide(reg::ring_time_us + 2 * (newest % RING_DEPTH)),
                bench.read_wide(reg::loadcell_time_us));
}
