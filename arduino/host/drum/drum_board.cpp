#include "drum_board.h"

#include <algorithm>
#include <cmath>

namespace {

constexpr uint16_t BEAT_EVERY_MS = 20;
constexpr uint64_t REPLY_CYCLES = 8000;  // a chip needs about 0.5 ms to compute a reply
// Diagnostics that only a chip has: on a PC nothing is late and no stack is short.
constexpr uint16_t FREE_STACK_BYTES = 4096, ALL_IDLE_PERMILLE = 1000;

bool has(uint8_t bits, Signal signal) { return bits >> static_cast<uint8_t>(signal) & 1; }

// The board whose firmware runs in this thread; the functions of ports.h take no board.
thread_local DrumBoard *running = nullptr;

class Running {
  public:
    explicit Running(DrumBoard *board) : before_(running) { running = board; }
    ~Running() { running = before_; }

  private:
    DrumBoard *before_;
};

}  // namespace

DrumBoard::DrumBoard() {
    eeprom_.fill(0xff);
    io.steps_per_turn = board::STEPS_PER_TURN;
    io.step_size = 1;
    io.conversion_in_step = 1;
}

void DrumBoard::boot(uint8_t reset_cause) {
    const Running here(this);
    cut();
    to_board_.clear();
    to_host_.clear();
    reset_cause_ = reset_cause;
    booted_ = cycle_;
    next_tick_ = cycle_ + CYCLES_PER_TICK;
    milliseconds_ = 0;
    engine_ = StepEngine();
    potentiometer_ = Potentiometer();
    store_ = Store();
    sync_ = {0, 0, 0, false};
    mark_ = {0, 0};
    estop_latched_ = estop_told_ = false;
    store_.begin();
    drum_.reset(new Drum());
    drum_->boot(false);
    report();
}

// --- time ---------------------------------------------------------------------------------------

uint64_t DrumBoard::next_event() const {
    uint64_t next = next_tick_;
    if (engine_.moving()) next = std::min(next, next_step_q8_ >> 8);
    if (io.conversion_due)
        next = std::min(next, static_cast<uint64_t>(io.conversion_cycle));
    if (!to_board_.empty()) next = std::min(next, to_board_.first().cycle);
    return std::max(next, cycle_);
}

void DrumBoard::run(uint64_t until_cycle) {
    const Running here(this);
    const uint64_t begun = duty_since_ = cycle_;
    duty_sum_ = 0;
    for (uint64_t next = next_event(); next <= until_cycle; next = next_event()) {
        cycle_ = next;
        happen();
    }
    cycle_ = until_cycle;
    count_duty();
    const bool passed = until_cycle > begun;
    io.drive = passed ? duty_sum_ / static_cast<double>(until_cycle - begun) : 0;
    io.position = place_now();
    report();
}

// Handles one event, the most urgent first, as interrupts precede the main loop.
void DrumBoard::happen() {
    if (engine_.moving() && next_step_q8_ >> 8 <= cycle_) return step();
    if (next_tick_ <= cycle_) return tick();
    if (io.conversion_due && static_cast<uint64_t>(io.conversion_cycle) <= cycle_)
        return convert();
    take_byte();
}

void DrumBoard::tick() {
    next_tick_ += CYCLES_PER_TICK;
    ++milliseconds_;
    look_at_estop();
    store_.tick();
    Inputs inputs;
    inputs.now_ms = milliseconds_;
    inputs.position_um = potentiometer_.position_um();
    inputs.position_raw = potentiometer_.raw();
    inputs.estop_open = estop_latched_ || estop_open();
    estop_latched_ = estop_fitted_ && estop_open();
    inputs.end_up = io.end_up;
    inputs.end_down = io.end_down;
    inputs.index_high = index_pin_;
    potentiometer_.take(static_cast<uint16_t>(io.potentiometer));
    if (io.heartbeat_on && milliseconds_ % BEAT_EVERY_MS == 0) beat();
    drum_->modbus().tick();
    drum_->tick(inputs);
}

void DrumBoard::convert() {
    io.conversion_due = 0;
    drum_->sample({static_cast<int32_t>(io.conversion_counts), now_us(),
                   io.conversion_in_step != 0});
    if (drum_->control_due()) drum_->control_force();
}

// A reply that does not fit into the transmit ring is dropped completely.
void DrumBoard::take_byte() {
    const uint8_t byte = to_board_.first().byte;
    to_board_.drop_first();
    const uint16_t length = drum_->modbus().take(byte);
    if (!length || to_host_.waiting(cycle_) + length >= SEND_SIZE) return;
    const uint8_t *reply = drum_->modbus().reply();
    for (uint16_t i = 0; i < length; ++i) to_host_.put(reply[i], cycle_ + REPLY_CYCLES);
    send_out();
}

// --- stepper ------------------------------------------------------------------------------------

void DrumBoard::step() {
    const Mark mark = engine_.count_step();
    turn(engine_.backwards());
    move_sync(mark);
    next_step_q8_ += engine_.next_interval();
}

// The drum takes the duration of a step to reach each new step.
double DrumBoard::place_now() const {
    const uint64_t since = cycle_ - stepped_;
    if (since >= step_length_) return steps_;
    const double left = steps_ - from_;
    return from_ + left * static_cast<double>(since) / static_cast<double>(step_length_);
}

void DrumBoard::turn(bool backwards) {
    if (!stepper_on_ || io.motor_jammed) return;
    from_ = place_now();
    step_length_ = std::min(cycle_ - stepped_, LONGEST_STEP);
    stepped_ = cycle_;
    const bool turns_back = io.direction == 2 ? false : backwards != (io.direction == 1);
    steps_ += turns_back ? -io.step_size : io.step_size;
    show_mark();
}

void DrumBoard::place(int64_t steps) {
    steps_ = from_ = io.position = static_cast<double>(steps);
    show_mark();
}

// Edges of the index mark; the leading edge forwards is the trailing edge backwards.
void DrumBoard::show_mark() {
    const double turn = static_cast<double>(io.steps_per_turn), at = std::fmod(steps_, turn);
    const bool level = (at < 0 ? at + turn : at) < static_cast<double>(io.mark_length_steps);
    const bool pin = level != static_cast<bool>(io.mark_inverted);
    if (pin != index_pin_ && (pin != index_inverted_) != engine_.backwards())
        mark_ = {engine_.position(), static_cast<uint16_t>(mark_.count + 1)};
    index_pin_ = pin;
    if (level == mark_level_) return;
    mark_level_ = level;
    report_edge(EdgeOf::Index, level);
}

void DrumBoard::show_sync(bool on) {
    const bool level = (on && sync_fitted_) != sync_inverted_;
    if (level == sync_level_) return;
    sync_level_ = level;
    report_edge(EdgeOf::Sync, level);
}

void DrumBoard::move_sync(Mark mark) {
    if (mark == Mark::None) return;
    sync_.high = mark == Mark::SyncOn;
    show_sync(sync_.high);
    if (sync_.high) {
        sync_.rise_us = now_us();
        ++sync_.count;
    } else {
        sync_.fall_us = now_us();
    }
}

void DrumBoard::enable_stepper(bool on) { stepper_on_ = on && !estop_latched_; }

void DrumBoard::start(const Motion &motion) {
    engine_.begin(motion);
    const uint32_t first = engine_.next_interval();
    if (!first || estop_latched_) return engine_.abandon();
    next_step_q8_ = (cycle_ << 8) + first;
}

void DrumBoard::stop_gently() {
    engine_.stop();
    if (sync_.high) move_sync(Mark::SyncOff);
}

void DrumBoard::stop_at_once() {
    engine_.abandon();
    if (sync_.high) move_sync(Mark::SyncOff);
}

// --- actuator, emergency stop -------------------------------------------------------------------

// Integrates the duty up to now.
void DrumBoard::count_duty() {
    const double duty = bridge_on_ ? permille_ * 1e-3 : 0;
    duty_sum_ += duty * static_cast<double>(cycle_ - duty_since_);
    duty_since_ = cycle_;
}

void DrumBoard::enable_bridge(bool on) {
    count_duty();
    bridge_on_ = on && !estop_latched_;
    if (!bridge_on_) permille_ = 0;
}

void DrumBoard::drive(int16_t permille) {
    count_duty();
    permille_ = estop_latched_ ? 0 : permille;
}

void DrumBoard::cut() {
    count_duty();
    engine_.abandon();
    stepper_on_ = bridge_on_ = false;
    permille_ = 0;
    show_sync(false);
    sync_.high = false;
}

bool DrumBoard::estop_open() const { return estop_level_ != estop_inverted_; }

void DrumBoard::look_at_estop() {
    if (!estop_fitted_ || !estop_open() || estop_latched_) return;
    estop_latched_ = true;
    cut();
}

void DrumBoard::set_estop(bool level) {
    const Running here(this);
    estop_level_ = level;
    look_at_estop();
}

// Levels before the wiring is configured are ignored; after that, an opening is latched until the
// firmware has read it, because a change of the wiring could hide it.
void DrumBoard::wire_signals(uint8_t fitted, uint8_t inverted) {
    estop_fitted_ = has(fitted, Signal::Estop);
    estop_inverted_ = has(inverted, Signal::Estop);
    estop_latched_ = (estop_told_ && estop_latched_) || (estop_fitted_ && estop_open());
    estop_told_ = true;
    index_inverted_ = has(inverted, Signal::Index);
    sync_fitted_ = has(fitted, Signal::Sync);
    sync_inverted_ = has(inverted, Signal::Sync);
    show_sync(sync_.high);
}

// --- cables and reports -------------------------------------------------------------------------

void DrumBoard::receive(const uint8_t *bytes, int32_t count, uint64_t from_cycle) {
    for (int32_t i = 0; i < count; ++i) to_board_.put(bytes[i], from_cycle);
    io.rx_end_cycle = static_cast<int64_t>(to_board_.free_at());
}

void DrumBoard::send_out() {
    for (; !to_host_.empty(); to_host_.drop_first()) {
        if (io.tx_count == MAX_BYTES) {
            ++io.overflows;
            continue;
        }
        io.tx_cycle[io.tx_count] = static_cast<int64_t>(to_host_.first().cycle);
        io.tx[io.tx_count++] = to_host_.first().byte;
    }
}

void DrumBoard::report_edge(EdgeOf signal, bool level) {
    if (io.edge_count == MAX_EDGES) {
        ++io.overflows;
        return;
    }
    io.edge_cycle[io.edge_count] = static_cast<int64_t>(cycle_);
    io.edge_signal[io.edge_count] = static_cast<int64_t>(signal);
    io.edge_level[io.edge_count++] = level;
}

void DrumBoard::report() {
    const int64_t state = static_cast<int64_t>(drum_->machine().state());
    const int64_t fault = static_cast<int64_t>(drum_->machine().fault());
    const int64_t result = static_cast<int64_t>(drum_->result());
    if (state != io.state || fault != io.fault || result != io.result)
        ++io.change_count;
    io.state = state;
    io.fault = fault;
    io.result = result;
    io.sample_sequence = drum_->loadcell().sequence();
    io.boot_cycle = static_cast<int64_t>(booted_);
    io.bridge_on = bridge_on_;
    io.stepper_on = stepper_on_;
}

int32_t DrumBoard::write(uint16_t address, uint16_t count, const uint8_t *bytes) {
    const Running here(this);
    const Answer answer = drum_->registers().write(address, count, bytes);
    report();
    return static_cast<int32_t>(answer);
}

void DrumBoard::read(uint16_t address, uint16_t count, uint16_t *words) {
    const Running here(this);
    drum_->registers().refresh();
    for (uint16_t i = 0; i < count; ++i) words[i] = drum_->registers().read(address + i);
}

void DrumBoard::poll() {
    read(static_cast<uint16_t>(io.poll_address), static_cast<uint16_t>(io.poll_count),
         io.poll_words);
}

void DrumBoard::beat() {
    ++beat_;
    const uint8_t bytes[2] = {static_cast<uint8_t>(beat_ >> 8), static_cast<uint8_t>(beat_)};
    drum_->registers().write(reg::heartbeat, 1, bytes);
}

ports::Health DrumBoard::health() const {
    return {0, 0, FREE_STACK_BYTES, ALL_IDLE_PERMILLE, store_.boot_count(), reset_cause_};
}

// --- ports.h ------------------------------------------------------------------------------------

namespace ports {

uint32_t now_us() { return running->now_us(); }
Health health() { return running->health(); }
void enable_stepper(bool on) { running->enable_stepper(on); }
void start(const Motion &motion) { running->start(motion); }
void stop_gently() { running->stop_gently(); }
void stop_at_once() { running->stop_at_once(); }
bool moving() { return running->moving(); }
bool at_speed() { return running->engine().at_speed(); }
uint32_t step_interval() { return running->engine().interval(); }
int32_t position() { return running->engine().position(); }
void shift_position(int32_t by) { running->shift_position(by); }
SyncLine sync_line() { return running->sync_line(); }
IndexMark index_mark() { return running->index_mark(); }
void wire_signals(uint8_t fitted, uint8_t inverted) { running->wire_signals(fitted, inverted); }
void enable_bridge(bool on) { running->enable_bridge(on); }
void drive(int16_t permille) { running->drive(permille); }
SettingsFrom load(uint16_t *words) { return running->store().load(words); }
void save(const uint16_t *words) { running->store().save(words); }
bool saving() { return running->store().saving(); }
uint32_t commissioned() { return running->store().commissioned(); }
void commission(uint32_t hash) { running->store().commission(hash); }
Place place() { return running->store().place(); }
void keep_place(const Place &place) { running->store().keep_place(place); }
uint8_t stored_byte(uint16_t address) { return running->stored(address); }
bool store_ready() { return true; }
void store_byte(uint16_t address, uint8_t byte) { running->stored(address) = byte; }

}  // namespace ports
