#include "bench.h"

#include <algorithm>
#include <cmath>

#include "variant.h"

namespace {

Bench *current = nullptr;
constexpr double MM_PER_STEP = board::NM_PER_STEP * 1e-6;
constexpr double TURN_MM = board::STEPS_PER_TURN * MM_PER_STEP;

}  // namespace

Bench::Bench(const BenchParameters &parameters) : p(parameters), random_(parameters.seed) {
    current = this;
    rod_mm = p.start_mm;
    felt_.assign(static_cast<size_t>(p.average_ms), 0.0);
    drum.boot(false);
    run(200);
}

Bench::~Bench() { current = nullptr; }

void Bench::run(int ms) {
    for (int i = 0; i < ms; ++i) one_ms();
}

bool Bench::run_until(const std::function<bool()> &condition, int limit_ms) {
    for (int i = 0; i < limit_ms && !condition(); ++i) one_ms();
    return condition();
}

Answer Bench::write(uint16_t address, std::initializer_list<uint16_t> words) {
    std::vector<uint8_t> bytes;
    for (uint16_t word : words) {
        bytes.push_back(static_cast<uint8_t>(word >> 8));
        bytes.push_back(static_cast<uint8_t>(word));
    }
    return drum.registers().write(address, static_cast<uint16_t>(words.size()), bytes.data());
}

Answer Bench::write_wide(uint16_t address, int32_t value) {
    const auto raw = static_cast<uint32_t>(value);
    return write(address, {static_cast<uint16_t>(raw >> 16), static_cast<uint16_t>(raw)});
}

Answer Bench::command(Command command) {
    return write(reg::command, {static_cast<uint16_t>(command), ++sequence_});
}

uint16_t Bench::read(uint16_t address) {
    drum.registers().refresh();
    return drum.registers().read(address);
}

int32_t Bench::read_wide(uint16_t address) {
    return static_cast<int32_t>(static_cast<uint32_t>(read(address)) << 16 | read(address + 1));
}

bool Bench::finish(int limit_ms) {
    run_until([&] { return result() != CommandResult::Running; }, limit_ms);
    return result() == CommandResult::Done;
}

bool Bench::commission() { return command(Command::Commission) == Answer::Ok && finish(100); }

void Bench::touch_cell() {
    for (double g : {0.0, 300.0, -300.0}) {
        push_g += g;
        run(300);
    }
}

bool Bench::arm_and_tare() {
    return commission() && command(Command::Arm) == Answer::Ok && finish(8000) &&
           command(Command::Tare) == Answer::Ok && finish(2000);
}

bool Bench::hold(double grams, int limit_ms) {
    write(reg::force_set, {static_cast<uint16_t>(std::lround(grams * 10))});
    return command(Command::Approach) == Answer::Ok && finish(limit_ms);
}

void Bench::one_ms() {
    ++time_ms;
    if (beating && time_ms % 20 == 0) write(reg::heartbeat, {++beat_});
    make_steps();
    move_actuator();
    touch();
    while (next_conversion_us_ <= now_us()) convert();
    const double shown_mm = inverted_position ? 50 - rod_mm : rod_mm;
    constexpr int TOP = board::POSITION_TOP_RAW, BOTTOM = board::POSITION_BOTTOM_RAW;
    long raw = TOP + std::lround(shown_mm * (BOTTOM - TOP) / 50);
    if (broken_position >= 0) raw = broken_position;
    position_.take(static_cast<uint16_t>(raw));
    if (swapped_ends) std::swap(end_up, end_down);
    Inputs inputs = {time_ms, position_.position_um(), position_.raw(),
                     estop_open, end_up != inverted_ends, end_down != inverted_ends, false};
    drum.tick(inputs);
    if (each_ms) each_ms();
}

void Bench::start(const Motion &motion) {
    engine.begin(motion);
    next_step_q8_ = static_cast<uint64_t>(time_ms) * 16000 * 256 + engine.next_interval();
}

// Steps due by now; the drum follows its steps exactly.
void Bench::make_steps() {
    const uint64_t now_q8 = static_cast<uint64_t>(time_ms) * 16000 * 256;
    while (engine.moving() && next_step_q8_ <= now_q8) {
        const uint32_t cycle = static_cast<uint32_t>(next_step_q8_ >> 8);
        const Mark window = engine.count_step();
        if (keep_steps) step_cycles.push_back(cycle);
        true_steps_ += engine.backwards() ? -1 : 1;
        const bool at_mark = true_steps_ % board::STEPS_PER_TURN == 0;
        if (at_mark && !mark_hidden) mark = {engine.position(), static_cast<uint16_t>(mark.count + 1)};
        if (window == Mark::SyncOn) {
            sync.high = true;
            sync.rise_us = cycle / 16;
            ++sync.count;
        } else if (window == Mark::SyncOff) {
            sync.high = false;
            sync.fall_us = cycle / 16;
        }
        const uint32_t interval = engine.next_interval();
        if (!interval) break;
        next_step_q8_ += interval;
    }
    drum_mm = true_steps_ * MM_PER_STEP;
}

void Bench::move_actuator() {
    double duty = bridge_on ? drive_permille / 1000.0 : 0;
    if (swapped_actuator) duty = -duty;
    const double least = p.dead_band + (std::fabs(velocity_) < 0.01 ? p.stiction : 0);
    double target = 0;
    if (std::fabs(duty) > least)
        target = std::copysign((std::fabs(duty) - p.dead_band) / (1 - p.dead_band), duty) *
                 p.actuator_speed_mm_s;
    const double before = velocity_;
    velocity_ += (target - velocity_) * (1 - std::exp(-1 / p.lag_ms));
    if (actuator_jammed) velocity_ = 0;
    rod_mm += velocity_ * 1e-3;
    if (rod_mm <= 0 || rod_mm >= 50) velocity_ = 0;
    rod_mm = std::clamp(rod_mm, 0.0, 50.0);
    end_up = rod_mm <= 0.01 || upper_end_open;
    end_down = rod_mm >= 49.99;
    const double angle = 2 * M_PI * drum_mm / TURN_MM;
    const double inertia = p.moved_mass_g * (velocity_ - before) / 9.81;
    felt_.push_back(force_g + push_g + inertia + p.imbalance_g * std::sin(angle));
    felt_.pop_front();
}

double Bench::rod_force(double depth_mm) const {
    return depth_mm <= 0 ? 0 : p.stiffness_g_mm * depth_mm * (1 + p.stiffening_per_mm * depth_mm);
}

// The weight holds the screw's play on one flank until the contact carries more than it.
void Bench::touch() {
    const double angle = 2 * M_PI * drum_mm / TURN_MM;
    const double ripple = p.ripple_mm * std::sin(2 * M_PI * drum_mm / p.ripple_period_mm);
    const double surface = p.contact_mm - p.run_out_mm * std::sin(angle + p.run_out_phase) - ripple;
    const double low = rod_mm + p.backlash_mm / 2 - surface;
    force_g = rod_force(low);
    if (force_g > p.weight_g) force_g = std::max(p.weight_g, rod_force(low - p.backlash_mm));
    peak_g = std::max(peak_g, force_g);
}

void Bench::convert() {
    const auto ready_us = static_cast<uint32_t>(next_conversion_us_);
    next_conversion_us_ += p.conversion_us;
    if (loadcell_silent) return;
    double mean = 0;
    for (double felt : felt_) mean += felt / static_cast<double>(felt_.size());
    if (cell_open) mean = 0;
    mean += p.noise_g * normal_(random_);
    int32_t raw = static_cast<int32_t>(std::lround(p.offset_counts + mean * 1e6 / p.ug_per_count));
    if (loadcell_saturated) raw = 0x7fffff;
    if (loadcell_frozen) raw = last_raw_;
    last_raw_ = raw;
    drum.sample({raw, ready_us, !out_of_step});
    if (drum.control_due()) drum.control_force();
}

namespace ports {

uint32_t now_us() { return current ? current->now_us() : 0; }
Health health() { return {0, 0, 0, 0, 1, 1}; }
void enable_stepper(bool on) { if (current) current->stepper_on = on; }
void start(const Motion &motion) { current->start(motion); }
void stop_gently() {
    current->engine.stop();
    current->sync.high = false;
}
void stop_at_once() {
    current->engine.abandon();
    current->sync.high = false;
}
bool moving() { return current->engine.moving(); }
bool at_speed() { return current->engine.at_speed(); }
uint32_t step_interval() { return current->engine.interval(); }
int32_t position() { return current->engine.position(); }
void shift_position(int32_t by) {
    current->engine.set_position(current->engine.position() + by);
}
SyncLine sync_line() { return current->sync; }
IndexMark index_mark() { return current->mark; }
void wire_signals(uint8_t, uint8_t) {}
void enable_bridge(bool on) { current->bridge_on = on; }
void drive(int16_t permille) { current->drive_permille = permille; }
uint32_t commissioned() { return current ? current->commissioned : 0; }
void commission(uint32_t hash) {
    current->commissioned = hash;
    current->saving = true;
}
Place place() { return current ? current->place : Place{0, 0}; }
void keep_place(const Place &place) { current->place = place; }
SettingsFrom load(uint16_t *) { return SettingsFrom::Defaults; }
void save(const uint16_t *) { current->saving = true; }
bool saving() {
    const bool was = current->saving;
    current->saving = false;
    return was;
}

}  // namespace ports
