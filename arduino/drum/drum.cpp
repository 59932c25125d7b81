#include "drum.h"

#include <math.h>
#include <stdlib.h>

#include "circle.h"   // sine and cosine of the drum's angle
#include "variant.h"  // geometry

namespace {

constexpr uint16_t SELFTEST_LIMIT_MS = board::LOADCELL_PERIOD_US / 25;  // 40 conversions
// FAULT_LIFT at least: with 250 ms of silence, off within 1 s where contact is gone by then.
constexpr uint16_t LIFT_TIME_MS = 700;
constexpr float WHOLE_TRAVEL_MS = board::ACTUATOR_TRAVEL_UM / board::ACTUATOR_MAX_MM_S;
constexpr uint16_t ACTUATOR_FULL_LIFT_MS = 1.2f * WHOLE_TRAVEL_MS;
constexpr uint16_t LIFT_LIMIT_MS = 1.6f * WHOLE_TRAVEL_MS;  // a lift that takes longer is stuck
constexpr uint8_t FREE_READINGS = 8;       // in a row: contact is gone, a coasting rod at rest
constexpr uint16_t GONE_UM = 3000;         // above the last contact: more than ridges and run-out
constexpr uint16_t TOP_UM = board::ACTUATOR_END_UM;  // the potentiometer at the upper end
constexpr uint16_t BOTTOM_UM = board::ACTUATOR_TRAVEL_UM - board::ACTUATOR_END_UM;
// Above the last contact: slowing down takes 0.9 mm, and begins with a sample.
constexpr uint16_t SLOW_ZONE_UM = 1400 + board::LOADCELL_PERIOD_US / 125;
constexpr float SEARCH_MM_S = 3.0f;        // near the surface, at most
// And so slow that contact is a matter of this time.
constexpr float SEARCH_S = (80000 + board::LOADCELL_PERIOD_US * 8 / 5) / 1e6f;
constexpr float QUICK_MM_S = board::ACTUATOR_MAX_MM_S < 8 ? board::ACTUATOR_MAX_MM_S : 8.0f;
constexpr float CONTACT_MM_S = board::ACTUATOR_MAX_MM_S < 6 ? board::ACTUATOR_MAX_MM_S : 6.0f;
constexpr float DEPTH_GAIN = 4.0f;         // 1/s
constexpr float DEPTH_REST_MM = 0.03f;     // the potentiometer shows 0.05 mm a count
constexpr float DEPTH_BAND_MM = 0.06f;
constexpr int16_t INDEX_TOLERANCE = 4;     // steps
constexpr int16_t INDEX_LATE = 40;
constexpr int32_t TARE_MAX_SPREAD_UG = 10000000;  // 10 g
constexpr float TWO_PI = 6.28318531f;

constexpr uint16_t bit(Fault fault) { return 1u << static_cast<uint8_t>(fault); }

bool supervised(State state) {
    return state != State::Boot && state != State::Selftest && state != State::Idle &&
           state != State::FaultOff;
}

}  // namespace

// What the wires say, with those put right that are inverted.
Inputs Drum::unwired(const Inputs &inputs) const {
    Inputs result = inputs;
    if (inverted(Signal::Index)) result.index_high = !inputs.index_high;
    if (inverted(Signal::EndSwitches)) {
        result.end_up = !inputs.end_up;
        result.end_down = !inputs.end_down;
    }
    if (inverted(Signal::Position))
        result.position_um = inputs.position_um < board::ACTUATOR_TRAVEL_UM
                                 ? board::ACTUATOR_TRAVEL_UM - inputs.position_um
                                 : 0;
    return result;
}

// Works out once what each sample needs: every product of numbers with a point costs 10 µs.
void Drum::apply_settings() {
    const float force_g = word(reg::force_set) * 0.1f;
    target_ = {force_g, word(reg::gain_p) * 0.01f, word(reg::gain_i) * 0.01f, 0};
    band_g_ = force_g * word(reg::settle_band) * 0.001f;
    over_force_g_ = word(reg::over_force) * 0.1f;
    actuator_.start_from(word(reg::dead_band_permille));
    rewire();
    tare_by_place_ = false;
    for (uint8_t place = 0; place < TARE_PLACES; ++place)
        if (word(reg::tare_place_00 + place)) tare_by_place_ = true;
    loadcell_.set_scale(bank_.wide(reg::tare_counts), bank_.wide(reg::scale_ug_per_count));
    judge_tare();
    judge_force();
}

// By which wires a lift was seen to end decides what is known of contact and zero.
void Drum::rewire() {
    constexpr uint8_t OF_THE_LIFT = 1 << static_cast<uint8_t>(Signal::EndSwitches) |
                                    1 << static_cast<uint8_t>(Signal::Position);
    const uint8_t fitted = word(reg::optional_signals), inverted = word(reg::signal_polarity);
    const uint8_t changed = (fitted ^ fitted_) | (inverted ^ inverted_);
    fitted_ = fitted;
    inverted_ = inverted;
    ports::wire_signals(fitted, inverted);
    if (!(changed & OF_THE_LIFT)) return;
    contact_known_ = false;
    zero_.forget();
    free_run_ = 0;
    if (contact_ == Contact::Gone) contact_ = Contact::Unknown;
}

void Drum::judge_tare() { tare_holds_ = zero_.near(bank_.wide(reg::tare_counts)); }

// Once by the settings, either way, since with a scale of the wrong sign pressing reads as pulling;
// and once by what no setting moves. A tare far from the board's own zero makes no force of counts.
void Drum::judge_force() {
    over_force_ = tare_holds_ && fabsf(loadcell_.force_g()) > over_force_g_;
    if (!loadcell_.saturated() && zero_.exceeded(loadcell_.raw())) over_force_ = true;
}

void Drum::boot(bool watchdog_reset) {
    restore_defaults();
    SettingsFrom from = ports::load(bank_.settings());
    if (from == SettingsFrom::Saved && !bank_.settings_valid()) {
        restore_defaults();
        from = SettingsFrom::Damaged;
    }
    bank_.put(reg::settings_from, static_cast<uint16_t>(from));
    report_identity();
    apply_settings();
    enter(State::Boot);
    go(Event::Booted);
    if (watchdog_reset) raise(Fault::Hang);
}

// --- supervision ------------------------------------------------------------------------------

// Causes that are there now, one bit per fault.
uint16_t Drum::causes() const {
    uint16_t bits = 0;
    if (estop_open()) bits |= bit(Fault::Estop);
    if (machine_.state() == State::Boot || machine_.state() == State::Selftest) return bits;
    bits |= loadcell_.faults();
    if (over_force_) bits |= bit(Fault::OverForce);
    const bool wanted = supervised(machine_.state()) || machine_.fault() == Fault::Heartbeat;
    if (wanted && heartbeat_.silent(word(reg::heartbeat_limit_ms))) bits |= bit(Fault::Heartbeat);
    return bits;
}

void Drum::supervise() {
    const uint16_t bits = causes();
    if (!bits) return;
    for (uint8_t n = 1; n < FAULT_COUNT; ++n)
        if (bits >> n & 1) raise(static_cast<Fault>(n));
}

void Drum::raise(Fault fault) {
    machine_.raise(fault, inputs_.now_ms);
    follow();
}

void Drum::go(Event event) {
    if (machine_.handle(event)) follow();
}

// Carries out a change of state, whoever caused it.
void Drum::follow() {
    if (machine_.state() != entered_) enter(machine_.state());
}

// --- states -----------------------------------------------------------------------------------

void Drum::enter(State state) {
    entered_ = state;
    entered_ms_ = inputs_.now_ms;
    free_run_ = 0;
    const Outputs outputs = machine_.outputs();
    const bool may_step = outputs.stepper_may_step;
    if (!may_step) ports::stop_at_once();
    if (state == State::Retract || state == State::FaultLift) ports::stop_gently();
    const bool actuator_on = machine_.drive() != Drive::Off;
    if (state != State::Position) turning_tare_ = false;
    if (state != State::Hold) step_test_.abandon();
    if (!outputs.stepper_enabled) homed_ = false;  // anybody may turn a drum that is off
    ports::enable_stepper(outputs.stepper_enabled);
    ports::enable_bridge(actuator_on);
    // APPROACH, HOLD and RUN hand the loop on without a hole in what was commanded.
    if (machine_.drive() == Drive::Lift) lift();
    else if (machine_.drive() == Drive::Off || machine_.drive() == Drive::Hold) actuator_.rest();
    move_actuator();
}

void Drum::move_actuator() {
    permille_ = actuator_.tick();
    ports::drive(permille_);
}

void Drum::tick(const Inputs &inputs) {
    inputs_ = unwired(inputs);
    heartbeat_.tick();
    loadcell_.tick(ports::now_us());
    supervise();
    watch_index();
    progress();
    progress_pending();
    if (fitted(Signal::Position)) actuator_.watch(inputs_.position_um);
    move_actuator();
}

void Drum::sample(const Conversion &conversion) {
    const bool by_place = tare_by_place_ && homed_;
    const uint16_t *table = bank_.settings() + (reg::tare_place_00 - SETTINGS_START);
    loadcell_.set_place_tare(by_place ? TareTurn::between(table, place_in_turn()) : 0);
    if (!loadcell_.take(conversion)) return;
    watch_reading();
    if (turning_tare_ && ports::at_speed()) tare_turn_.add(conversion.raw, place_in_turn());
    judge_force();
    supervise();
    thought_due_ = true;
}

void Drum::think() {
    thought_due_ = false;
    const Drive mode = machine_.drive();
    if (mode == Drive::Approach || mode == Drive::ForceLoop) press();
}

uint16_t Drum::place_in_turn() const {
    const int32_t place = ports::position() % board::STEPS_PER_TURN;
    return static_cast<uint16_t>(place < 0 ? place + board::STEPS_PER_TURN : place);
}

DrumTurn Drum::turn() {
    constexpr float RAD_S_TIMES_INTERVAL = TWO_PI / board::STEPS_PER_TURN * board::CLOCK_HZ * 256.0f;
    constexpr int16_t STEPS_PER_PART = board::STEPS_PER_TURN / 256;
    const int16_t place = ports::position() % board::STEPS_PER_TURN;
    const uint8_t part = static_cast<uint8_t>(place / STEPS_PER_PART);
    const uint32_t interval = ports::step_interval();
    if (interval != turn_interval_) {
        turn_interval_ = interval;
        turn_rate_ = interval ? RAD_S_TIMES_INTERVAL / interval : 0;
        if (backwards_) turn_rate_ = -turn_rate_;
    }
    return {circle::cosine(part), circle::sine(part), turn_rate_};
}

bool Drum::within_band() const {
    if (force_mode() == ForceMode::Position) return fabsf(depth_missing_mm()) <= DEPTH_BAND_MM;
    return fabsf(loadcell_.force_g() - target_.force_g) <= band_g_;
}

// From the first touch to the actuator's stop pass about 60 ms; what is travelled meanwhile must
// stay below the set force, also where the contact is half as stiff again as believed.
float Drum::search_speed() const {
    const float depth_mm = target_.force_g / word(reg::stiffness_g_per_mm);
    const float speed = depth_mm / SEARCH_S;
    return speed < SEARCH_MM_S ? speed : SEARCH_MM_S;
}

// One step of the force loop: in APPROACH, HOLD and RUN, at each sample.
void Drum::press() {
    const bool near_contact = !contact_known_ || !fitted(Signal::Position) ||
                              inputs_.position_um + SLOW_ZONE_UM >= contact_um_;
    const bool searching = !force_.in_contact();
    target_.speed_limit = CONTACT_MM_S;
    if (searching) target_.speed_limit = near_contact ? search_speed() : QUICK_MM_S;
    float speed = force_.update(loadcell_.force_g(), target_, turn());
    if (searching && force_.in_contact()) touched();
    if (force_.in_contact()) speed = other_mode(speed);
    if (speed > target_.speed_limit) speed = target_.speed_limit;
    force_.commanded(speed);
    actuator_.want(speed);
    if (!within_band()) outside_ms_ = inputs_.now_ms;
}

void Drum::touched() {
    contact_ms_ = outside_ms_ = inputs_.now_ms;
    contact_um_ = inputs_.position_um;
    contact_known_ = true;
}

// What moves the actuator in contact where it is not the force loop.
float Drum::other_mode(float speed) {
    if (step_test_.running()) return step_test_.sample(loadcell_.force_g());
    if (locked_) return 0;
    if (force_mode() != ForceMode::Position) return speed;
    const float missing = depth_missing_mm();
    return fabsf(missing) < DEPTH_REST_MM ? 0 : DEPTH_GAIN * missing;
}

float Drum::depth_missing_mm() const {
    const float wanted = word(reg::depth_set_um) * 0.001f;
    if (!fitted(Signal::Position)) return wanted - force_.depth_mm();
    const int32_t depth_um = static_cast<int32_t>(inputs_.position_um) - contact_um_;
    return wanted - static_cast<float>(depth_um) * 0.001f;
}

void Drum::progress() {
    switch (machine_.state()) {
        case State::Selftest: selftest(); break;
        case State::Position: position_move(); break;
        case State::Approach: approach(); break;
        case State::Run:
            if (!ports::moving()) go(Event::TravelDone);
            break;
        case State::Retract: lift(); break;
        case State::FaultLift: lift(); break;
        default: break;
    }
    const bool presses = permille_ > 0;
    const bool at_bottom = fitted(Signal::Position) && inputs_.position_um >= BOTTOM_UM;
    if (presses && (end_down() || at_bottom))
        raise(Fault::ActuatorEnd);
}

void Drum::selftest() {
    if (loadcell_.alive()) go(Event::SelftestPassed);
    else if (inputs_.now_ms - entered_ms_ > SELFTEST_LIMIT_MS) raise(Fault::Selftest);
}

void Drum::approach() {
    const uint32_t since_start = inputs_.now_ms - entered_ms_;
    if (!force_.in_contact()) {
        const uint16_t limit = word(reg::approach_limit_um);
        const bool too_far = fitted(Signal::Position) &&
                             inputs_.position_um > static_cast<uint32_t>(start_um_) + limit;
        const bool too_long = since_start > limit / (0.5f * search_speed()) + 500;
        if (too_far || too_long) raise(Fault::NoContact);
        return;
    }
    if (inputs_.now_ms - outside_ms_ >= word(reg::settle_time_ms)) {
        bank_.put(reg::stiffness_g_per_mm, lroundf(force_.stiffness()));
        locked_ = force_mode() == ForceMode::Lock;
        go(Event::ForceSettled);
    } else if (inputs_.now_ms - contact_ms_ > word(reg::approach_timeout_ms)) {
        raise(Fault::ForceUnreached);
    }
}

bool Drum::lifted_clear() const {
    const uint32_t since_start = inputs_.now_ms - entered_ms_;
    const uint32_t clearance = word(reg::lift_clearance_um);
    if (at_upper_end()) return true;
    if (!fitted(Signal::Position))
        return !fitted(Signal::EndSwitches) && since_start > ACTUATOR_FULL_LIFT_MS &&
               !reads_contact();
    if (inputs_.position_um <= TOP_UM) return true;
    // A fault lifts as far as its time allows: whatever happened, distance helps.
    if (machine_.state() == State::FaultLift) return false;
    return contact_known_ && inputs_.position_um + clearance <= contact_um_ && !reads_contact();
}

// A lift goes on until contact is gone. One that must be weighed ends when it has been.
void Drum::lift() {
    const bool retracting = machine_.state() == State::Retract;
    const uint32_t since_start = inputs_.now_ms - entered_ms_;
    const bool clear = lifted_clear();
    if (clear) actuator_.rest();
    else actuator_.lift();
    if (clear) contact_ = Contact::Gone;
    watch_contact();
    const bool gone = contact_ == Contact::Gone;
    const bool late = since_start > LIFT_LIMIT_MS;
    if (late) lift_failed_ = !gone;
#ifdef SHORT_LIFT  // a broken image that the tests must catch
    if (!retracting && since_start >= LIFT_TIME_MS) return go(Event::LiftTimeOver);
#endif
    if (!retracting) {
        if ((gone && since_start >= LIFT_TIME_MS) || late) go(Event::LiftTimeOver);
    } else if (clear && !ports::moving() && zero_.known()) {
        go(Event::Lifted);
    } else if (late) {
        raise(Fault::ActuatorEnd);
    }
}

// --- contact ------------------------------------------------------------------------------------

// The cell shows a force, as far as it can be believed.
bool Drum::reads_contact() const {
    return zero_.known() && !loadcell_.faults() && !zero_.free(loadcell_.raw());
}

// By the upper end, by the reading, or by the way above the last contact.
bool Drum::contact_gone() const {
    if (at_upper_end() || free_run_ >= FREE_READINGS) return true;
    if (!fitted(Signal::Position)) return false;
    if (inputs_.position_um <= TOP_UM) return true;
    return contact_known_ && inputs_.position_um + GONE_UM <= contact_um_ && !reads_contact();
}

// Not while the drum is pressed down: then contact may come at any moment.
void Drum::watch_contact() {
    if (contact_ != Contact::Gone && contact_gone()) contact_ = Contact::Gone;
    if (contact_ == Contact::Gone) lift_failed_ = false;
}

// What a sample tells of contact; the lifted drum is weighed wherever it stands still.
void Drum::watch_reading() {
    const Drive drive = machine_.drive();
    if (drive == Drive::Approach || drive == Drive::ForceLoop) return zero_.disturb();
    const int32_t raw = loadcell_.raw();
    const bool sound = !loadcell_.faults();
    if (!sound || !zero_.free(raw)) free_run_ = 0;
    else if (free_run_ < FREE_READINGS) ++free_run_;
    if (drive == Drive::Off) watch_contact();
    const State state = machine_.state();
    const bool lifts = state == State::Armed || state == State::Retract;
    const bool still = contact_ == Contact::Gone && !permille_ && !ports::moving();
    if (!sound || !lifts || !still) return zero_.disturb();
    if (zero_.weigh(raw)) judge_tare();
}

void Drum::position_move() {
    if (ports::moving()) return;
    if (turning_tare_) end_tare_turn();
    const bool failed = homing_ && !homed_;
    homing_ = false;
    if (failed) finish(CommandResult::Failed);
    go(Event::MoveDone);
}

// --- index mark ---------------------------------------------------------------------------------

void Drum::watch_index() {
    if (!fitted(Signal::Index)) return;
    const ports::IndexMark mark = ports::index_mark();
    const bool fresh = mark.count != index_seen_;
    index_seen_ = mark.count;
    if (fresh && homing_) {
        ports::shift_position(-mark.position);
        ports::stop_gently();
        force_.forget_run_out();
        homed_ = true;
        homing_ = false;
        index_expected_ = 0;
        index_error_ = 0;
        return;
    }
    if (!homed_) return;
    constexpr int32_t TURN = board::STEPS_PER_TURN;
    if (fresh) {
        int32_t error = mark.position % TURN;
        if (error > TURN / 2) error -= TURN;
        if (error < -TURN / 2) error += TURN;
        index_error_ = static_cast<int16_t>(error);
        index_expected_ = mark.position - error;
        if (error > INDEX_TOLERANCE || error < -INDEX_TOLERANCE) raise(Fault::StepCount);
        return;
    }
    const int32_t since = ports::position() - index_expected_;
    if (since > TURN + INDEX_LATE || since < -TURN - INDEX_LATE) {
        index_expected_ = ports::position();
        raise(Fault::StepCount);
    }
}

// --- commands that take time ----------------------------------------------------------------------

void Drum::finish(CommandResult result) {
    if (pending_ == Pending::None) return;
    pending_ = Pending::None;
    result_ = result;
}

void Drum::progress_pending() {
    const State state = machine_.state();
    switch (pending_) {
        case Pending::None: return;
        case Pending::Change:
            if (state == pending_goal_) finish(CommandResult::Done);
            else if (state == State::FaultLift || state == State::FaultOff)
                finish(CommandResult::Failed);
            return;
        case Pending::Tare:
            if (!resting()) {
                loadcell_.abandon_tare();
                finish(CommandResult::Failed);
            } else if (!loadcell_.taring()) {
                end_tare();
            }
            return;
        case Pending::Save:
            if (!ports::saving()) finish(CommandResult::Done);
            return;
        case Pending::Tune:
            if (!step_test_.running()) end_tune();
            return;
    }
}

void Drum::end_tare() {
    const int64_t spread = static_cast<int64_t>(loadcell_.tare_spread()) *
                           labs(bank_.wide(reg::scale_ug_per_count));
    if (spread > TARE_MAX_SPREAD_UG) {
        if (!tare_tries_) return finish(CommandResult::Failed);
        --tare_tries_;
        return loadcell_.begin_tare();
    }
    const int32_t tare = loadcell_.tare_mean() - loadcell_.place_tare();
    const bool lifted = contact_ == Contact::Gone;
    if (!tare_anyway_ && !(lifted && near_zero(tare))) return finish(CommandResult::Failed);
    // Raw, as the limit is judged: tares of places are settings.
    if (lifted) zero_.take(loadcell_.tare_mean());
    bank_.put_wide(reg::tare_counts, static_cast<uint32_t>(tare));
    apply_settings();
    tared_ = true;
    finish(CommandResult::Done);
}

void Drum::end_tare_turn() {
    turning_tare_ = false;
    if (!tare_turn_.finish() || !near_zero(tare_turn_.mean()))
        return finish(CommandResult::Failed);
    zero_.take(tare_turn_.mean());
    bank_.put_wide(reg::tare_counts, static_cast<uint32_t>(tare_turn_.mean()));
    for (uint8_t place = 0; place < TARE_PLACES; ++place)
        bank_.put(reg::tare_place_00 + place, static_cast<uint16_t>(tare_turn_.at(place)));
    apply_settings();
    tared_ = true;
}

void Drum::end_tune() {
    if (machine_.state() != State::Hold || !step_test_.succeeded())
        return finish(CommandResult::Failed);
    const GainProposal &found = step_test_.proposal();
    bank_.put(reg::proposed_gain_p, lroundf(found.gain_p * 100));
    bank_.put(reg::proposed_gain_i, lroundf(found.gain_i * 100));
    bank_.put(reg::tuned_stiffness_g_per_mm, lroundf(found.stiffness_g_per_mm));
    bank_.put(reg::tuned_delay, lroundf(found.delay_s * 10000));
    finish(CommandResult::Done);
}
