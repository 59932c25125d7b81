#include "controller.h"

#include <math.h>

#include "ports.h"      // stepper, bridge, clock
#include "tare_turn.h"  // tare between places
#include "variant.h"    // sample period, travel

namespace {

constexpr uint32_t bit(Fault fault) { return 1UL << static_cast<uint8_t>(fault); }

// For 40 conversions; an amplifier settles for 400 ms before the first one.
constexpr uint16_t SELFTEST_LIMIT_MS = board::LOADCELL_SLOW_PERIOD_US / 25;
constexpr uint32_t SELFTEST_SILENCE_US = 5 * board::LOADCELL_SLOW_PERIOD_US;
// These forbid to arm; a board that drives nothing may be told of another rate.
constexpr uint32_t ARMING_ONLY = bit(Fault::LoadcellRate) | bit(Fault::LoadcellNoise);
// FAULT_LIFT at least: with 250 ms of silence, off within 1 s where contact is gone by then.
constexpr uint16_t LIFT_TIME_MS = 700;
// A lift that takes longer is stuck.
constexpr uint16_t LIFT_LIMIT_MS = 1.6f * (board::ACTUATOR_TRAVEL_UM / board::ACTUATOR_MAX_MM_S);
constexpr uint16_t GENTLE_LIMIT_MS = 1.6f * (board::ACTUATOR_TRAVEL_UM / board::GENTLE_LIFT_MM_S);

// The first motion since a boot may change the reading by this, and a lift may raise it by this:
// 0.1 mm on the stiffest contact.
constexpr uint16_t FIRST_FORCE_G = 150;
// Of a board that is not commissioned, whose potentiometer may say the opposite.
constexpr uint16_t GENTLE_FORCE_G = 60;
// A place that differs by less is not written: the EEPROM wears.
constexpr uint16_t KEPT_PLACE_UM = 300;
constexpr uint8_t LATE_LIFT_MS = 40;

bool needs_heartbeat(State state) {
    return state != State::Boot && state != State::Selftest && state != State::Idle &&
           state != State::FaultOff;
}

}  // namespace

// --- settings -----------------------------------------------------------------------------------

void Controller::apply_settings() {
    force_control_.configure();
    actuator_.start_from(bank_.word(reg::dead_band_permille));
    const uint8_t fitted = bank_.word(reg::optional_signals);
    const uint8_t inverted = bank_.word(reg::signal_polarity);
    if (signals_.configure(fitted, inverted)) contact_.forget();
    sensor_.configure(bank_);
    const uint32_t hash = commission_.hash();
    commission_.configure(bank_);
    if (hash != commission_.hash()) motion_.forget();
}

void Controller::restore_defaults() {
    bank_.restore_defaults();
    bank_.put(reg::optional_signals, board::SIGNALS_FITTED);
    bank_.put(reg::signal_polarity, board::SIGNALS_INVERTED);
    bank_.put(reg::loadcell_slow, board::LOADCELL_SLOW);
}

bool Controller::resting() const {
    return machine_.state() == State::Idle || machine_.state() == State::Armed;
}

bool Controller::may_change(Guard guard) const {
    if (!resting() || signals_.estop_open()) return false;
    if (contact_.gone()) return true;
    // After a boot nothing has been pressed yet, and arming lifts first.
    return guard == Guard::Resting && contact_.unknown();
}

// --- supervision ----------------------------------------------------------------------------------

uint32_t Controller::causes() const {
    uint32_t bits = 0;
    if (signals_.estop_open()) bits |= bit(Fault::Estop);
    const State state = machine_.state();
    if (state == State::Boot || state == State::Selftest) return bits;
    bits |= sensor_.loadcell().faults();
    if (sensor_.over_force()) bits |= bit(Fault::OverForce);
    // A drum that drives nothing may still be told that it has no potentiometer.
    if (machine_.drive() != Drive::Off && signals_.position_broken())
        bits |= bit(Fault::PositionWire);
    const bool needed = needs_heartbeat(state) || machine_.fault() == Fault::Heartbeat;
    if (needed && heartbeat_.silent(bank_.word(reg::heartbeat_limit_ms)))
        bits |= bit(Fault::Heartbeat);
    return bits;
}

void Controller::supervise() {
    uint32_t bits = causes();
    if (machine_.drive() == Drive::Off) bits &= ~ARMING_ONLY;
    if (!bits) return;
    for (uint8_t n = 1; n < FAULT_COUNT; ++n)
        if (bits >> n & 1) raise(static_cast<Fault>(n));
}

void Controller::raise(Fault fault) {
    machine_.raise(fault, signals_.now_ms());
    if (machine_.state() != entered_) enter(machine_.state());
}

// Lifting is no answer where it is not known what lifts.
void Controller::raise_off(Fault fault) {
    motion_.forget();
    machine_.raise(fault, signals_.now_ms());
    go(Event::OffFault);
}

void Controller::go(Event event) {
    if (machine_.handle(event) && machine_.state() != entered_) enter(machine_.state());
}

bool Controller::arm() {
    if (!machine_.accepts(Event::Arm) || causes()) return false;
    heartbeat_.restart();
    return true;
}

// A drum that has pressed and did not lift, before anybody has said that its wires are right: each
// further attempt may press a little more. A restart comes after a look at the wires.
bool Controller::needs_restart() const {
    return gentle() && contact_.pressed() && machine_.fault() != Fault::Estop;
}

bool Controller::clear_fault() {
    if (!machine_.accepts(Event::Clear) || causes() & ~ARMING_ONLY || needs_restart()) return false;
    machine_.clear();
    if (machine_.state() != entered_) enter(machine_.state());
    return true;
}

bool Controller::begin_nudge(bool presses) {
    if (!machine_.accepts(Event::Nudge) || causes()) return false;
    heartbeat_.restart();
    nudge_.begin(presses, signals_.position_um(), signals_.reads_position());
    return true;
}

void Controller::recall_place() {
    const ports::Place kept = ports::place();
    const bool unbounded = !contact_.place_known() && !sensor_.feels();
    if (unbounded && kept.hash == commission_.hash()) contact_.expect_place(kept.contact_um);
}

void Controller::keep_place() const {
    if (!contact_.place_known() || ports::saving()) return;
    const ports::Place kept = ports::place();
    const int32_t off_um = static_cast<int32_t>(contact_.place_um()) - kept.contact_um;
    const bool near = off_um <= KEPT_PLACE_UM && off_um >= -static_cast<int32_t>(KEPT_PLACE_UM);
    if (kept.hash == commission_.hash() && near) return;
    ports::keep_place({commission_.hash(), contact_.place_um()});
}

// --- states ---------------------------------------------------------------------------------------

void Controller::boot(bool watchdog_reset) {
    enter(State::Boot);
    go(Event::Booted);
    if (watchdog_reset) raise(Fault::Hang);
}

void Controller::enter(State state) {
    entered_ = state;
    entered_ms_ = signals_.now_ms();
    contact_.restart();
    const Outputs outputs = machine_.outputs();
    const Drive drive = machine_.drive();
    if (!outputs.stepper_may_step) ports::stop_at_once();
    if (state == State::Retract || state == State::FaultLift) ports::stop_gently();
    if (state != State::Hold) force_control_.step_test().abandon();
    if (!outputs.stepper_enabled) axis_.forget_angle();
    ports::enable_stepper(outputs.stepper_enabled);
    ports::enable_bridge(drive != Drive::Off);
    // APPROACH, HOLD and RUN hand the force loop on without a gap in its commands.
    if (drive == Drive::Lift && gentle()) motion_.begin_ramp();
    if (drive == Drive::Lift) lift();
    else if (drive == Drive::Off || drive == Drive::Hold) actuator_.rest();
    drive_actuator();
}

void Controller::drive_actuator() {
    const Drive drive = machine_.drive();
    const bool slowly = drive == Drive::Lift && gentle();
    duty_ = drive == Drive::Nudge ? nudge_.tick(signals_.position_um())
                                  : motion_.limited(actuator_.tick(), slowly);
    ports::drive(duty_);
}

void Controller::tick(const Inputs &inputs) {
    signals_.update(inputs);
    heartbeat_.tick();
    sensor_.loadcell().tick(ports::now_us());
    if (signals_.estop_open()) motion_.forget();
    supervise();
    watch_index();
    watch_motion();
    watch_force();
    progress();
    if (signals_.reads_position() && motion_.known()) actuator_.watch(signals_.position_um());
    drive_actuator();
}

void Controller::watch_index() {
    if (!signals_.fitted(Signal::Index)) return;
    switch (axis_.watch_index()) {
        case Axis::IndexEvent::Homed: return force_control_.forget_run_out();
        case Axis::IndexEvent::StepsLost: return raise(Fault::StepCount);
        case Axis::IndexEvent::None: return;
    }
}

// A nudge finds out which way the actuator goes; every other motion has to know.
void Controller::watch_motion() {
    const Drive drive = machine_.drive();
    if (drive == Drive::Off) motion_.end();
    if (drive == Drive::Off || drive == Drive::Nudge) return;
    const MotionWatch::Finding found = motion_.check(duty_, signals_);
    if (found == MotionWatch::Finding::None) return;
    if (drive == Drive::Lift) contact_.lift_too_long();
    motion_.forget();
    raise(found == MotionWatch::Finding::Stuck ? Fault::ActuatorStuck : Fault::ActuatorReversed);
}

// In the tick after the force loop's step, which alone takes most of a millisecond.
void Controller::watch_force() {
    if (!watch_due_) return;
    watch_due_ = false;
    const Drive drive = machine_.drive();
    if (drive != Drive::Approach && drive != Drive::ForceLoop) return;
    const Fault found = force_control_.watch(drive == Drive::ForceLoop, ports::moving());
    if (found != Fault::None) raise(found);
}

void Controller::progress() {
    switch (machine_.state()) {
        case State::Selftest: selftest(); break;
        case State::Position:
            if (ports::moving()) break;
            axis_.end_move();
            go(Event::MoveDone);
            break;
        case State::Approach: approach(); break;
        case State::Run:
            if (!ports::moving()) go(Event::TravelDone);
            break;
        case State::Retract:
        case State::FaultLift: lift(); break;
        case State::Nudge: nudge_on(); break;
        default: break;
    }
    if (duty_ > 0 && (signals_.end_down() || signals_.at_bottom())) raise(Fault::ActuatorEnd);
}

void Controller::selftest() {
    const Loadcell &cell = sensor_.loadcell();
    const bool silent = cell.silent_us(ports::now_us()) > SELFTEST_SILENCE_US;
    if (cell.test().known()) go(Event::SelftestPassed);
    else if (silent || in_state_ms() > SELFTEST_LIMIT_MS) raise(Fault::Selftest);
}

void Controller::approach() {
    if (!force_control_.in_contact()) {
        if (force_control_.finds_nothing(in_state_ms())) raise(Fault::NoContact);
    } else if (force_control_.settled()) {
        bank_.put(reg::stiffness_g_per_mm, lroundf(force_control_.loop().stiffness()));
        force_control_.reached();
        if (commission_.holds()) keep_place();
        go(Event::ForceSettled);
    } else if (force_control_.settles_too_late()) {
        raise(Fault::ForceUnreached);
    }
}

// RETRACT ends with a drum that is high enough, stands still and has been weighed. FAULT_LIFT goes as
// far as its time allows, because distance helps, and continues until contact is gone.
void Controller::lift() {
    const bool retracting = machine_.state() == State::Retract;
    const uint32_t lifting_ms = in_state_ms();
    const bool high =
        contact_.high_enough(!retracting, {lifting_ms, bank_.word(reg::lift_clearance_um), gentle()});
    if (high) actuator_.rest();
    else actuator_.lift(gentle() && !motion_.stands());
    if (high) contact_.set_gone();
    contact_.watch();
    const bool late = lifting_ms > (gentle() ? GENTLE_LIMIT_MS : LIFT_LIMIT_MS);
    if (late) contact_.lift_too_long();
    if (!retracting) {
        if ((contact_.gone() && lifting_ms >= LIFT_TIME_MS) || late) go(Event::LiftTimeOver);
    } else if (high && !ports::moving() && sensor_.zero().known()) {
        go(Event::Lifted);
    } else if (late) {
        raise(Fault::ActuatorEnd);
    }
}

void Controller::nudge_on() {
    if (nudge_.presses() ? signals_.end_down() : signals_.end_up()) nudge_.end();
    if (!nudge_.over()) return;
    const int16_t travel_um = nudge_.presses() ? nudge_.travel_um() : -nudge_.travel_um();
    if (travel_um >= MotionWatch::PROGRESS_UM) motion_.confirm();
    else motion_.forget();
    go(Event::Nudged);
}

// --- samples --------------------------------------------------------------------------------------

bool Controller::sample(const Conversion &conversion) {
    if (!sensor_.take(conversion, place_tare())) return false;
    sensor_.loadcell().test(machine_.drive() == Drive::Off);
    watch_contact();
    watch_unlimited_force();
    watch_gentle_nudge();
    sensor_.check_limits();
    supervise();
    control_due_ = true;
    return true;
}

// A lift whose rod no longer comes down from what it did before, and whose samples show that.
bool Controller::lifts_surely() const {
    const bool slow = bank_.word(reg::loadcell_slow);
    const uint32_t late_ms = LATE_LIFT_MS + sampling::of(slow).period_us / 512;
    return machine_.drive() == Drive::Lift && in_state_ms() >= late_ms;
}

// Until a zero exists no limit of the force does, and none ends a lift. The drum may become lighter,
// as a lift does; before the potentiometer has shown that a first motion lifts, not even that. On a
// board that is not commissioned and has no potentiometer nothing ever shows it: with the actuator and
// the cell both reversed, what presses reads as what lifts. What a lift has pressed counts in the next
// one too.
void Controller::watch_unlimited_force() {
    constexpr int32_t FIRST = board::counts_of(FIRST_FORCE_G), GENTLE = board::counts_of(GENTLE_FORCE_G);
    const int32_t raw = sensor_.loadcell().steady_raw();
    const bool first = !sensor_.zero().known();
    if (!first && !lifts_surely()) {
        const Drive drive = machine_.drive();
        if (motion_.known() || drive == Drive::Approach) lift_pressed_ = false;
        if (!lift_pressed_) moved_ = false;
        return;
    }
    if (!duty_) return;
    // Where the zero is known, a reading further away from it is a load, whatever the scale says.
    const bool loads_down =
        first ? bank_.wide(reg::scale_ug_per_count) < 0 : raw < sensor_.zero().counts();
    if (!moved_) least_raw_ = raw;
    if (!moved_ || motion_.known()) first_raw_ = raw;
    moved_ = true;
    if (loads_down ? raw > least_raw_ : raw < least_raw_) least_raw_ = raw;
    const int32_t loaded = loads_down ? least_raw_ - raw : raw - least_raw_;
    const int32_t off = raw > first_raw_ ? raw - first_raw_ : first_raw_ - raw;
    const bool never_shown = gentle() && !signals_.fitted(Signal::Position);
    const bool blind = first && !motion_.known() && (signals_.reads_position() || never_shown);
    lift_pressed_ = loaded > (gentle() ? GENTLE : FIRST);
    if (lift_pressed_ || (blind && off > FIRST)) raise_off(Fault::ForceUnexplained);
}

// Nudge after nudge may press, where the potentiometer says that they lift.
void Controller::watch_gentle_nudge() {
    constexpr int32_t MOST = board::counts_of(GENTLE_FORCE_G);
    if (machine_.drive() != Drive::Nudge || !gentle()) return;
    if (sensor_.zero().loaded(sensor_.loadcell().steady_raw(), MOST)) raise_off(Fault::ForceUnexplained);
}

int32_t Controller::place_tare() const {
    if (!sensor_.tare_by_place() || !axis_.homed()) return 0;
    return TareTurn::between(bank_.tare_places(), axis_.place_in_turn());
}

// A lifted drum is weighed wherever it stands still.
void Controller::watch_contact() {
    const Drive drive = machine_.drive();
    sensor_.look_for_touch(drive == Drive::Off);
    if (drive == Drive::Approach || drive == Drive::ForceLoop) return sensor_.zero().disturb();
    const bool lifts = machine_.state() == State::Armed || machine_.state() == State::Retract;
    contact_.take_reading(drive == Drive::Off, lifts && !duty_ && !ports::moving());
}

void Controller::control_force() {
    control_due_ = false;
    const Drive drive = machine_.drive();
    if (drive == Drive::Approach || drive == Drive::ForceLoop)
        actuator_.want(force_control_.step());
    watch_due_ = true;
}
