#include "commands.h"

#include <math.h>

#include "ports.h"    // stepper, saved settings
#include "variant.h"  // limit of the force

bool Commands::start(Command command, uint16_t sequence) {
    const Pending before = pending_;
    pending_ = Pending::None;
    if (!begin(command)) {
        pending_ = before;
        return false;
    }
    if (before == Pending::Tare && pending_ != Pending::Tare) taring_.abandon();
    if (before == Pending::Tune && pending_ != Pending::Tune)
        controller_.force_control().step_test().abandon();
    acknowledged_ = sequence;
    result_ = pending_ == Pending::None ? CommandResult::Done : CommandResult::Running;
    return true;
}

bool Commands::begin(Command command) {
    switch (command) {
        case Command::None: return true;
        case Command::Arm: return controller_.arm() && follow(Event::Arm);
        case Command::Disarm: return follow(Event::Disarm);
        case Command::Move: return move();
        case Command::Approach: return approach();
        case Command::Run: return run();
        case Command::Retract: return follow(Event::Retract);
        case Command::Stop: return follow(Event::Stop);
        case Command::Clear: return controller_.clear_fault();
        case Command::Tare: return tare(false);
        case Command::TareAnyway: return tare(true);
        case Command::ZeroSteps: return zero_steps();
        case Command::Home: return home();
        case Command::Save: return save();
        case Command::Defaults: return defaults();
        case Command::Tune: return tune();
        case Command::TareTurn: return tare_turn();
        case Command::Nudge: return nudge();
        case Command::Commission: return commission();
        case Command::ApproachSetup: return approach_setup();
    }
    return false;
}

// Follows the event. Where that starts a passing state, the command runs until the state is over.
bool Commands::follow(Event event) {
    if (!controller_.machine().accepts(event)) return false;
    controller_.go(event);
    switch (controller_.machine().state()) {
        case State::Position:
            pending_ = Pending::Move;
            goal_ = State::Armed;
            break;
        case State::Retract:
            pending_ = Pending::Change;
            goal_ = State::Armed;
            break;
        case State::Approach:
        case State::Run:
            pending_ = Pending::Change;
            goal_ = State::Hold;
            break;
        case State::Nudge:
            pending_ = Pending::Change;
            goal_ = State::Idle;
            break;
        default: break;
    }
    return true;
}

// A drum that the cell feels on something does not turn, whatever the other wires say.
bool Commands::move() {
    if (controller_.sensor().reads_contact() || !follow(Event::Move)) return false;
    controller_.axis().move();
    return true;
}

bool Commands::home() {
    if (!controller_.signals().fitted(Signal::Index)) return false;
    if (controller_.sensor().reads_contact() || !follow(Event::Move)) return false;
    controller_.axis().home();
    return true;
}

bool Commands::approach() {
    return controller_.commission().holds() && press(false);
}

// Before the board is commissioned, the one that the set-up needs.
bool Commands::approach_setup() {
    constexpr uint16_t MOST_SETUP_TENTHS = 1000;
    return bank_.word(reg::force_set) <= MOST_SETUP_TENTHS && press(true);
}

// A set force too near a limit would end in OVER_FORCE at the first overshoot.
bool Commands::press(bool for_setup) {
    constexpr uint32_t MOST_TENTHS = board::MOST_FORCE_G * 10UL;
    if (!controller_.machine().accepts(Event::Approach)) return false;
    if (!controller_.contact().gone() || !controller_.sensor().tare_holds()) return false;
    // A cell that was broken before it was weighed shows it only to a finger.
    if (!controller_.cell_trusted()) return false;
    // A cell that came loose at rest shows something else.
    if (!controller_.sensor().reads_zero()) return false;
    const uint32_t highest = bank_.word(reg::force_set) + bank_.word(reg::force_set) / 10U;
    if (highest > bank_.word(reg::over_force) || highest > MOST_TENTHS) return false;
    // Also at twice the speed that is asked for, less than 250 g on the stiffest contact.
    constexpr int32_t SETUP_COUNTS = board::counts_of(200);
    controller_.sensor().zero().limit(for_setup ? SETUP_COUNTS : board::MOST_COUNTS);
    controller_.recall_place();
    controller_.contact().press();
    controller_.force_control().begin(for_setup);
    return follow(Event::Approach);
}

bool Commands::nudge() {
    return controller_.begin_nudge(bank_.word(reg::nudge_direction) != 0) && follow(Event::Nudge);
}

bool Commands::commission() {
    if (!controller_.may_change(Guard::Resting) || ports::saving()) return false;
    if (controller_.commission().holds()) return true;
    controller_.commission().keep();
    controller_.keep_place();
    pending_ = Pending::Save;
    return true;
}

bool Commands::run() {
    if (controller_.force_control().step_test().running()) return false;
    if (!controller_.commission().holds()) return false;
    if (!controller_.axis().run_in_suffices() || !follow(Event::Run)) return false;
    controller_.axis().run();
    return true;
}

bool Commands::tare(bool forced) {
    if (!taring_.begin(forced)) return false;
    pending_ = Pending::Tare;
    return true;
}

// The lifted drum turns from wherever it is, and has to know its angle.
bool Commands::tare_turn() {
    if (!controller_.axis().homed() || controller_.sensor().loadcell().faults()) return false;
    if (!controller_.contact().gone() || !follow(Event::Move)) return false;
    taring_.begin_turn();
    controller_.axis().tare_turn();
    return true;
}

// Only while the force loop holds a force and the drum stands still.
bool Commands::tune() {
    ForceControl &control = controller_.force_control();
    if (controller_.machine().state() != State::Hold || control.mode() != ForceMode::Hold)
        return false;
    bank_.put(reg::proposed_gain_p, 0);
    bank_.put(reg::proposed_gain_i, 0);
    control.begin_step_test();
    pending_ = Pending::Tune;
    return true;
}

bool Commands::zero_steps() {
    if (ports::moving()) return false;
    controller_.axis().zero_position();
    controller_.force_control().forget_run_out();
    return true;
}

bool Commands::save() {
    if (!controller_.resting() || ports::saving()) return false;
    ports::save(bank_.settings());
    pending_ = Pending::Save;
    return true;
}

bool Commands::defaults() {
    if (!controller_.may_change(Guard::Resting)) return false;
    controller_.restore_defaults();
    controller_.apply_settings();
    taring_.set_tared(false);
    return true;
}

// --- commands that take time ----------------------------------------------------------------------

void Commands::tick() {
    if (taring_.tick_turn() == Taring::Progress::Failed) finish(CommandResult::Failed);
    switch (pending_) {
        case Pending::None: return;
        case Pending::Change: return progress_change(true);
        case Pending::Move: return progress_change(!controller_.axis().home_missed());
        case Pending::Tare: return finish(taring_.tick());
        case Pending::Save:
            if (!ports::saving()) finish(CommandResult::Done);
            return;
        case Pending::Tune:
            if (!controller_.force_control().step_test().running()) end_tune();
            return;
    }
}

void Commands::progress_change(bool done_well) {
    const State state = controller_.machine().state();
    if (state == goal_) finish(done_well ? CommandResult::Done : CommandResult::Failed);
    else if (state == State::FaultLift || state == State::FaultOff) finish(CommandResult::Failed);
}

void Commands::finish(CommandResult result) {
    if (pending_ == Pending::None) return;
    pending_ = Pending::None;
    result_ = result;
}

void Commands::finish(Taring::Progress progress) {
    if (progress == Taring::Progress::Running) return;
    finish(progress == Taring::Progress::Done ? CommandResult::Done : CommandResult::Failed);
}

void Commands::end_tune() {
    const StepTest &test = controller_.force_control().step_test();
    if (controller_.machine().state() != State::Hold || !test.succeeded())
        return finish(CommandResult::Failed);
    const GainProposal &found = test.proposal();
    bank_.put(reg::proposed_gain_p, lroundf(found.gain_p * 100));
    bank_.put(reg::proposed_gain_i, lroundf(found.gain_i * 100));
    bank_.put(reg::tuned_stiffness_g_per_mm, lroundf(found.stiffness_g_per_mm));
    bank_.put(reg::tuned_delay, lroundf(found.delay_s * 10000));
    const uint16_t band = controller_.actuator().dead_band(), began = controller_.nudge().duty();
    bank_.put(reg::tuned_dead_band, band);
    bank_.put(reg::tuned_stiction, began > band ? began - band : 0);
    bank_.put(reg::tuned_rate, lroundf(controller_.actuator().full_mm_s() * 100));
    finish(CommandResult::Done);
}
