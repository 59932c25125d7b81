#include "motion_watch.h"

#include "variant.h"  // speed and lag of the actuator

namespace {

constexpr int16_t RAMP_PERMILLE = 2;  // a millisecond: 0.1 mm of travel at a fifth of the full speed
// After five time constants a rod stands.
constexpr uint8_t COAST_MS = board::ACTUATOR_LAG_S * 5000;
// The lag as a power of two, because a division would cost each tick 12 µs.
constexpr uint8_t LAG_SHIFT = board::ACTUATOR_LAG_S > 0.045f ? 6 : 5, LAG_TICKS = 1 << LAG_SHIFT;
// Way of a rod that was driven the other way until now, for each permille of that duty; the
// potentiometer shows it 10 ms later, and the actuator may be twice as fast as it should be.
constexpr float COAST_UM = 2 * board::ACTUATOR_MAX_MM_S * (board::ACTUATOR_LAG_S + 0.010f);
constexpr uint32_t COAST_UM_TIMES_1024 = COAST_UM * 1024;
// No actuator that the rig can use needs more to start.
constexpr int16_t SURE_DUTY = 450;
// A worn actuator moves at an eighth of its speed. The potentiometer shows it 16 ms later.
constexpr float PROGRESS_MS = board::ACTUATOR_LAG_S * 4000 + 16 +
                              MotionWatch::PROGRESS_UM / (board::ACTUATOR_MAX_MM_S / 8);
constexpr uint32_t MOST_OWED = static_cast<uint32_t>(PROGRESS_MS) * (Actuator::FULL - SURE_DUTY);
constexpr uint8_t CLEAR_MS = 50;  // a switch that was left no longer bounces

int16_t size_of(int16_t value) { return value < 0 ? -value : value; }
int8_t way_of(int16_t duty) { return duty > 0 ? 1 : duty < 0 ? -1 : 0; }
void count(uint8_t &ms, bool goes_on) { ms = !goes_on ? 0 : ms < 255 ? ms + 1 : 255; }

}  // namespace

void MotionWatch::forget() {
    known_ = false;
    ramp_ = 0;
    ramped_way_ = way_ = 0;
    rest_ms_ = 255;
    recent_ = 0;
}

int16_t MotionWatch::limited(int16_t duty, bool gentle) {
    const int8_t way = way_of(duty);
    if ((known_ && !gentle) || !way) return duty;
    if (way != ramped_way_) ramp_ = 0;
    ramped_way_ = way;
    ramp_ += RAMP_PERMILLE;
    if (ramp_ > size_of(duty)) ramp_ = size_of(duty);
    return way * ramp_;
}

void MotionWatch::progressed(uint16_t position_um) {
    start_um_ = from_um_ = position_um;
    coast_um_ = 0;
    owed_ = 0;
    still_ms_ = 0;
}

void MotionWatch::begin(int8_t way, uint16_t position_um) {
    progressed(position_um);
    coast_um_ = static_cast<int16_t>(recent_ * COAST_UM_TIMES_1024 >> 10);
    way_ = way;
}

void MotionWatch::watch_rest(int16_t duty) {
    count(rest_ms_, !duty);
    recent_ -= (recent_ + LAG_TICKS - 1) >> LAG_SHIFT;
    if (size_of(duty) > recent_) recent_ = size_of(duty);
    if (rest_ms_ >= COAST_MS) way_ = 0;
}

// Both ends together are a broken wire, and say nothing of the way.
bool MotionWatch::wrong_end(const Signals &signals) const {
    const bool up = signals.end_up(), down = signals.end_down();
    if (up == down) return false;
    if (way_ < 0) return down && clear_down_ms_ >= CLEAR_MS;
    return signals.at_upper_end() && clear_up_ms_ >= CLEAR_MS;
}

MotionWatch::Finding MotionWatch::compare(int16_t duty, const Signals &signals) {
    const uint16_t position_um = signals.position_um();
    const int32_t from_start = along(start_um_, position_um), travel = along(from_um_, position_um);
    if (from_start <= -PROGRESS_UM - coast_um_) return Finding::Reversed;
    if (travel < 0) from_um_ = position_um;
    const bool ended = way_ < 0 && (signals.at_top() || signals.at_upper_end());
    if (travel >= PROGRESS_UM || ended) {
        if (travel >= PROGRESS_UM) known_ = true;
        progressed(position_um);
        return Finding::None;
    }
    if (still_ms_ < STILL_MS) ++still_ms_;
    if (size_of(duty) > SURE_DUTY) owed_ += size_of(duty) - SURE_DUTY;
    return owed_ > MOST_OWED ? Finding::Stuck : Finding::None;
}

MotionWatch::Finding MotionWatch::check(int16_t duty, const Signals &signals) {
    const int8_t way = way_of(duty);
    if (way && way != way_) begin(way, signals.position_um());
    watch_rest(duty);
    const bool wrong = way && wrong_end(signals);
    count(clear_up_ms_, !signals.end_up());
    count(clear_down_ms_, !signals.end_down());
    if (wrong) return Finding::Reversed;
    if (!way || !signals.reads_position()) return Finding::None;
    return compare(duty, signals);
}
