#include "axis.h"

#include "circle.h"     // sine and cosine of the angle
#include "ports.h"      // stepper, index mark
#include "tare_turn.h"  // steps of a place
#include "variant.h"    // geometry

namespace {

constexpr uint16_t HOMING_SPEED = 6000;  // 0.01 mm/s
constexpr uint16_t TARE_SPEED = 4000;
constexpr uint32_t HOMING_STEPS = board::STEPS_PER_TURN * 5UL / 4;
constexpr int16_t INDEX_TOLERANCE = 4;   // steps
constexpr int16_t INDEX_LATE = 40;
constexpr float TWO_PI = 6.28318531f;

uint32_t steps_of(uint16_t tenths_mm) {
    return (tenths_mm * 100000UL + board::NM_PER_STEP / 2) / board::NM_PER_STEP;
}

}  // namespace

// --- motions ------------------------------------------------------------------------------------

void Axis::start(const Motion &motion, uint16_t speed) {
    homing_ = false;  // an interrupted search for the mark must not end this motion there
    Motion complete = motion;
    const int16_t trim_ppm = static_cast<int16_t>(bank_.word(reg::clock_trim_ppm));
    complete.profile = ramp::profile(speed, bank_.word(reg::acceleration_set), trim_ppm);
    cruise_speed_ = speed;
    backwards_ = motion.backwards;
    ports::start(complete);
}

void Axis::move() {
    const int32_t way = bank_.wide(reg::move_target) - ports::position();
    const uint32_t steps = way < 0 ? -way : way;
    start({{}, way < 0, steps, ENDLESS, 0}, bank_.word(reg::move_speed_set));
}

void Axis::home() {
    homed_ = false;
    start({{}, false, HOMING_STEPS, ENDLESS, 0}, HOMING_SPEED);
    homing_ = true;
}

void Axis::tare_turn() {
    const uint32_t ramp_steps = ramp::steps_to_speed(TARE_SPEED, bank_.word(reg::acceleration_set));
    const uint32_t steps = board::STEPS_PER_TURN + 2 * ramp_steps + TareTurn::PLACE_STEPS;
    start({{}, false, steps, ENDLESS, 0}, TARE_SPEED);
}

bool Axis::run_in_suffices() const {
    const uint16_t speed = bank_.word(reg::speed_set);
    const uint32_t settling = speed * 10UL * bank_.word(reg::run_settle_ms) / board::NM_PER_STEP;
    const uint32_t ramp_steps = ramp::steps_to_speed(speed, bank_.word(reg::acceleration_set));
    return steps_of(bank_.word(reg::run_in_set)) >= ramp_steps + settling;
}

void Axis::run() {
    const bool backwards = bank_.word(reg::direction_set) != 0;
    const uint32_t run_in = steps_of(bank_.word(reg::run_in_set));
    const uint32_t window = steps_of(bank_.word(reg::travel_set));
    start({{}, backwards, ENDLESS, run_in, window}, bank_.word(reg::speed_set));
}

void Axis::end_move() {
    home_missed_ = homing_;
    homing_ = false;
}

uint16_t Axis::speed() const {
    return ports::at_speed() ? cruise_speed_ : ramp::speed_of(ports::step_interval());
}

// --- index mark ---------------------------------------------------------------------------------

Axis::IndexEvent Axis::watch_index() {
    constexpr int32_t TURN = board::STEPS_PER_TURN;
    const ports::IndexMark mark = ports::index_mark();
    const bool fresh = mark.count != index_seen_;
    index_seen_ = mark.count;
    if (fresh && homing_) {
        ports::shift_position(-mark.position);
        ports::stop_gently();
        homed_ = true;
        homing_ = false;
        index_expected_ = 0;
        index_error_ = 0;
        return IndexEvent::Homed;
    }
    if (!homed_) return IndexEvent::None;
    if (fresh) {
        int32_t error = mark.position % TURN;
        if (error > TURN / 2) error -= TURN;
        if (error < -TURN / 2) error += TURN;
        index_error_ = static_cast<int16_t>(error);
        index_expected_ = mark.position - error;
        const bool lost = error > INDEX_TOLERANCE || error < -INDEX_TOLERANCE;
        return lost ? IndexEvent::StepsLost : IndexEvent::None;
    }
    const int32_t since = ports::position() - index_expected_;
    if (since <= TURN + INDEX_LATE && since >= -TURN - INDEX_LATE) return IndexEvent::None;
    index_expected_ = ports::position();
    return IndexEvent::StepsLost;
}

void Axis::zero_position() {
    ports::shift_position(-ports::position());
    index_expected_ = 0;
    homed_ = false;
}

// --- angle --------------------------------------------------------------------------------------

uint16_t Axis::place_in_turn() const {
    const int32_t place = ports::position() % board::STEPS_PER_TURN;
    return static_cast<uint16_t>(place < 0 ? place + board::STEPS_PER_TURN : place);
}

DrumTurn Axis::turn() {
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
