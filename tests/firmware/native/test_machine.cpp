// The state machine against the generated table, state by state and event by event.
#include "check.h"
#include "machine.h"

namespace {

// Ways to bring a fresh machine into each state.
struct Way {
    State state;
    std::initializer_list<Event> events;
};

const Way WAYS[] = {
    {State::Boot, {}},
    {State::Selftest, {Event::Booted}},
    {State::Idle, {Event::Booted, Event::SelftestPassed}},
    {State::Retract, {Event::Booted, Event::SelftestPassed, Event::Arm}},
    {State::Armed, {Event::Booted, Event::SelftestPassed, Event::Arm, Event::Lifted}},
    {State::Position,
     {Event::Booted, Event::SelftestPassed, Event::Arm, Event::Lifted, Event::Move}},
    {State::Approach,
     {Event::Booted, Event::SelftestPassed, Event::Arm, Event::Lifted, Event::Approach}},
    {State::Hold,
     {Event::Booted, Event::SelftestPassed, Event::Arm, Event::Lifted, Event::Approach,
      Event::ForceSettled}},
    {State::Run,
     {Event::Booted, Event::SelftestPassed, Event::Arm, Event::Lifted, Event::Approach,
      Event::ForceSettled, Event::Run}},
    {State::FaultLift,
     {Event::Booted, Event::SelftestPassed, Event::Arm, Event::Lifted, Event::TimedFault}},
    {State::FaultOff, {Event::OffFault}},
    {State::Nudge, {Event::Booted, Event::SelftestPassed, Event::Nudge}},
};

Machine in(const Way &way) {
    Machine machine;
    for (Event event : way.events) CHECK(machine.handle(event));
    return machine;
}

}  // namespace

TEST(every_state_is_reached) {
    CHECK_EQUAL(sizeof WAYS / sizeof *WAYS, STATE_COUNT);
    for (const Way &way : WAYS) CHECK(in(way).state() == way.state);
}

TEST(every_event_in_every_state_does_what_the_table_says) {
    for (const Way &way : WAYS) {
        for (uint8_t e = 0; e < EVENT_COUNT; ++e) {
            Machine machine = in(way);
            const uint8_t target = TRANSITIONS[static_cast<uint8_t>(way.state)][e];
            CHECK_EQUAL(machine.accepts(static_cast<Event>(e)), target != REFUSED);
            CHECK_EQUAL(machine.handle(static_cast<Event>(e)), target != REFUSED);
            const State expected = target == REFUSED ? way.state : static_cast<State>(target);
            CHECK(machine.state() == expected);
        }
    }
}

TEST(nothing_is_driven_where_the_drum_is_off) {
    for (const Way &way : WAYS) {
        const Outputs outputs = in(way).outputs();
        const bool off = way.state == State::Boot || way.state == State::Selftest ||
                         way.state == State::Idle || way.state == State::FaultOff;
        CHECK_EQUAL(outputs.stepper_enabled, !off && way.state != State::Nudge);
        CHECK_EQUAL(static_cast<Drive>(outputs.drive) == Drive::Off, off);
        CHECK(!outputs.stepper_may_step || outputs.stepper_enabled);
    }
}

TEST(a_fault_lifts_or_switches_off_in_every_state) {
    for (const Way &way : WAYS) {
        for (uint8_t f = 1; f < FAULT_COUNT; ++f) {
            Machine machine = in(way);
            const bool driven = machine.drive() != Drive::Off && machine.drive() != Drive::Nudge;
            const bool lifts = LIFT_FAULTS >> f & 1;
            machine.raise(static_cast<Fault>(f), 77);
            const bool lifted = lifts && driven;
            CHECK(machine.state() == (lifted ? State::FaultLift : State::FaultOff));
            CHECK_EQUAL(machine.fault(), f);
            CHECK_EQUAL(machine.fault_at_ms(), 77);
        }
    }
}

TEST(the_first_fault_but_a_missed_heartbeat_stays_until_it_is_cleared) {
    Machine machine = in(WAYS[4]);
    machine.raise(Fault::Heartbeat, 1000);
    machine.raise(Fault::Estop, 1200);
    CHECK(machine.state() == State::FaultOff);
    // The computer clears a missed heartbeat by itself: it hides no other cause.
    CHECK(machine.fault() == Fault::Estop);
    CHECK_EQUAL(machine.fault_at_ms(), 1200);
    machine.raise(Fault::Heartbeat, 1300);
    machine.raise(Fault::OverForce, 1400);
    CHECK(machine.fault() == Fault::Estop);
    CHECK_EQUAL(machine.fault_at_ms(), 1200);
    CHECK(machine.clear());
    CHECK(machine.fault() == Fault::None);
    CHECK(machine.state() == State::Idle);
    CHECK(!machine.clear());
}
