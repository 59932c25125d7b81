// What each command needs before it is accepted, and what it starts.
#include "variant.h"  // geometry
#include "drum.h"

namespace {

constexpr uint8_t TARE_TRIES = 3;  // a drum just lifted still swings
constexpr uint16_t HOMING_SPEED = 6000;  // 0.01 mm/s
constexpr uint16_t TARE_SPEED = 4000;
constexpr uint32_t HOMING_STEPS = board::STEPS_PER_TURN * 5UL / 4;

uint32_t steps_of(uint16_t tenths_mm) {
    return (tenths_mm * 100000UL + board::NM_PER_STEP / 2) / board::NM_PER_STEP;
}

}  // namespace

// Accepts and starts a command, or refuses it and changes nothing.
bool Drum::command(Command command, uint16_t sequence) {
    const Pending before = pending_;
    pending_ = Pending::None;
    if (!begin(command)) {
        pending_ = before;
        return false;
    }
    if (before == Pending::Tare && pending_ != Pending::Tare) loadcell_.abandon_tare();
    if (before == Pending::Tune && pending_ != Pending::Tune) step_test_.abandon();
    acknowledged_ = sequence;
    result_ = pending_ == Pending::None ? CommandResult::Done : CommandResult::Running;
    return true;
}

bool Drum::begin(Command command) {
    switch (command) {
        case Command::None: return true;
        case Command::Arm: return arm();
        case Command::Disarm: return start_state(Event::Disarm);
        case Command::Move: return move();
        case Command::Approach: return approach_begin();
        case Command::Run: return run();
        case Command::Retract: return start_state(Event::Retract);
        case Command::Stop: return start_state(Event::Stop);
        case Command::Clear: return clear();
        case Command::Tare: return tare(false);
        case Command::TareAnyway: return tare(true);
        case Command::ZeroSteps: return zero_steps();
        case Command::Home: return home();
        case Command::Save: return save();
        case Command::Defaults: return defaults();
        case Command::Tune: return tune();
        case Command::TareTurn: return tare_turn();
    }
    return false;
}

// Follows the event; where it starts a passing state, the command runs until that is left.
bool Drum::start_state(Event event) {
    if (!machine_.accepts(event)) return false;
    go(event);
    switch (machine_.state()) {
        case State::Retract:
        case State::Position: pending_goal_ = State::Armed; break;
        case State::Approach:
        case State::Run: pending_goal_ = State::Hold; break;
        default: return true;
    }
    pending_ = Pending::Change;
    return true;
}

bool Drum::resting() const {
    return machine_.state() == State::Idle || machine_.state() == State::Armed;
}

// What decides what a force means, or what stops it.
bool Drum::may_change(Guard guard) const {
#ifdef NO_GUARD  // a broken image that the tests must catch
    return true;
#endif
#ifdef ESTOP_CONFIGURABLE  // another
    if (estop_open()) return true;
#endif
    if (!resting() || estop_open()) return false;
    if (contact_ == Contact::Gone) return true;
    // Nothing was pressed since the boot, and whatever is armed lifts first.
    return guard == Guard::Resting && contact_ == Contact::Unknown;
}

bool Drum::arm() {
    if (!machine_.accepts(Event::Arm) || causes()) return false;
    heartbeat_.restart();
    return start_state(Event::Arm);
}

void Drum::start(const Motion &motion, uint16_t speed) {
    Motion complete = motion;
    const int16_t trim_ppm = static_cast<int16_t>(word(reg::clock_trim_ppm));
    complete.profile = ramp::profile(speed, word(reg::acceleration_set), trim_ppm);
    cruise_speed_ = speed;
    backwards_ = motion.backwards;
    ports::start(complete);
}

bool Drum::move() {
    if (!machine_.accepts(Event::Move)) return false;
    const int32_t way = bank_.wide(reg::move_target) - ports::position();
    start_state(Event::Move);
    const uint32_t steps = way < 0 ? -way : way;
    start({{}, way < 0, steps, ENDLESS, 0}, word(reg::move_speed_set));
    return true;
}

bool Drum::home() {
    if (!machine_.accepts(Event::Move) || !fitted(Signal::Index)) return false;
    start_state(Event::Move);
    homed_ = false;
    homing_ = true;
    start({{}, false, HOMING_STEPS, ENDLESS, 0}, HOMING_SPEED);
    return true;
}

// A set force too near a limit would end in OVER_FORCE at the first overshoot.
bool Drum::approach_begin() {
    constexpr uint32_t MOST_TENTHS = board::MOST_FORCE_G * 10UL;
    if (!machine_.accepts(Event::Approach)) return false;
    if (contact_ != Contact::Gone || !tare_holds_) return false;
    const uint32_t highest = word(reg::force_set) + word(reg::force_set) / 10U;
    if (highest > word(reg::over_force) || highest > MOST_TENTHS) return false;
    contact_ = Contact::MayStand;
    start_um_ = inputs_.position_um;
    locked_ = false;
    force_.begin(word(reg::stiffness_g_per_mm));
    return start_state(Event::Approach);
}

// The ramp and its settling have to end before the trial window opens.
bool Drum::run() {
    if (!machine_.accepts(Event::Run) || step_test_.running()) return false;
    const uint16_t speed = word(reg::speed_set);
    const uint32_t run_in = steps_of(word(reg::run_in_set));
    const uint32_t settling = speed * 10UL * word(reg::run_settle_ms) / board::NM_PER_STEP;
    if (run_in < ramp::steps_to_speed(speed, word(reg::acceleration_set)) + settling)
        return false;
    start_state(Event::Run);
    const bool backwards = word(reg::direction_set) != 0;
    const uint32_t window = steps_of(word(reg::travel_set));
    start({{}, backwards, ENDLESS, run_in, window}, speed);
    return true;
}

bool Drum::clear() {
    if (!machine_.accepts(Event::Clear) || causes()) return false;
    machine_.clear();
    follow();
    return true;
}

// In contact, or far from the zero that the board knows, only where it is asked for by name.
bool Drum::tare(bool anyway) {
#ifdef TARE_IN_CONTACT  // a broken image that the tests must catch
    anyway = true;
#endif
    if (!resting() || loadcell_.faults()) return false;
    if (!anyway && (contact_ != Contact::Gone || !near_zero(loadcell_.raw()))) return false;
    tare_anyway_ = anyway;
    loadcell_.begin_tare();
    tare_tries_ = TARE_TRIES;
    pending_ = Pending::Tare;
    return true;
}

// A turn at constant speed, lifted, from wherever the drum is; needs to know its angle.
bool Drum::tare_turn() {
    if (!machine_.accepts(Event::Move) || !homed_ || loadcell_.faults()) return false;
    if (contact_ != Contact::Gone) return false;
    start_state(Event::Move);
    tare_turn_.begin();
    turning_tare_ = true;
    const uint32_t ramp_steps = ramp::steps_to_speed(TARE_SPEED, word(reg::acceleration_set));
    start({{}, false, board::STEPS_PER_TURN + 2 * ramp_steps + TareTurn::PLACE_STEPS, ENDLESS, 0},
          TARE_SPEED);
    return true;
}

// Only where the loop holds a force at a drum that stands.
bool Drum::tune() {
    if (machine_.state() != State::Hold || force_mode() != ForceMode::Hold) return false;
    bank_.put(reg::proposed_gain_p, 0);
    bank_.put(reg::proposed_gain_i, 0);
    step_test_.begin(target_.force_g, force_.stiffness());
    pending_ = Pending::Tune;
    return true;
}

bool Drum::zero_steps() {
    if (ports::moving()) return false;
    ports::shift_position(-ports::position());
    index_expected_ = 0;
    homed_ = false;
    force_.forget_run_out();
    return true;
}

bool Drum::save() {
    if (!resting() || ports::saving()) return false;
    ports::save(bank_.settings());
    pending_ = Pending::Save;
    return true;
}

void Drum::restore_defaults() {
    bank_.restore_defaults();
    bank_.put(reg::optional_signals, board::SIGNALS_FITTED);
    bank_.put(reg::signal_polarity, board::SIGNALS_INVERTED);
}

bool Drum::defaults() {
    if (!resting() || !may_change(Guard::Resting)) return false;
    restore_defaults();
    apply_settings();
    tared_ = false;
    return true;
}

void Drum::written(uint16_t address, uint16_t count) {
    const auto touched = [&](uint16_t place) {
        return place >= address && place - address < count;
    };
    if (touched(reg::heartbeat)) heartbeat_.seen(word(reg::heartbeat));
    if (address + count <= reg::signal_polarity) return;  // only the computer's own traffic
    if (touched(reg::tare_counts) || touched(reg::tare_counts + 1)) tared_ = true;
    apply_settings();
}
