#include "actuator.h"

namespace {

constexpr uint16_t RUN_UP_MS = 150;      // five time constants before a speed counts
constexpr uint16_t LEAST_TRAVEL_UM = 1500;
constexpr float SURE_TRAVEL_UM = 8000.0f;  // travel that weighs as much as all before
constexpr uint16_t LONGEST_WATCH_MS = 4000;
constexpr float LEAST_FULL_MM_S = 2.0f, MOST_FULL_MM_S = 40.0f;
constexpr float MOST_DEAD_BAND = 400.0f;

float size_of(float value) { return value < 0 ? -value : value; }

}  // namespace

int16_t Actuator::duty(float mm_s) const {
    float permille = dead_band_ + slope_ * size_of(mm_s);
    if (permille > FULL) permille = FULL;
    const int16_t rounded = static_cast<int16_t>(permille + 0.5f);
    return mm_s < 0 ? -rounded : rounded;
}

// The pulse's duty is worked out here, once a sample, and not each millisecond.
void Actuator::want(float mm_s) {
    pulsing_ = size_of(mm_s) < PULSE_MM_S;
    wanted_ = static_cast<int16_t>(mm_s * (WHOLE_PULSE / PULSE_MM_S));
    direct_ = duty(pulsing_ ? PULSE_MM_S : mm_s);
    if (pulsing_ && wanted_) return;
    owed_ = 0;
    if (pulsing_) pulse_left_ = pulse_ = 0;
}

void Actuator::lift(bool gently) {
    pulsing_ = false;
    direct_ = gently ? -gentle_ : -FULL;
}

// Each slot of PULSE_MS gives one pulse or none; what it gave too much or too little is owed.
int16_t Actuator::tick() {
    if (!pulsing_) return direct_;
    if (!pulse_left_) {
        pulse_left_ = PULSE_MS;
        owed_ += wanted_;
        pulse_ = 0;
        if (owed_ > WHOLE_PULSE / 2) pulse_ = direct_;
        if (owed_ < -WHOLE_PULSE / 2) pulse_ = -direct_;
        if (pulse_) owed_ -= pulse_ > 0 ? WHOLE_PULSE : -WHOLE_PULSE;
    }
    --pulse_left_;
    return pulse_;
}

void Actuator::watch(uint16_t position_um) {
    const int16_t now = pulsing_ ? 0 : direct_;
    if (now == watched_ && watched_ms_ < LONGEST_WATCH_MS) {
        if (watched_ms_ == RUN_UP_MS) started_um_ = position_um;
        ++watched_ms_;
        return;
    }
    const uint16_t travel = position_um > started_um_ ? position_um - started_um_
                                                      : started_um_ - position_um;
    if (watched_ && watched_ms_ > RUN_UP_MS && travel > LEAST_TRAVEL_UM)
        learn(travel, watched_ms_ - RUN_UP_MS);
    watched_ = now;
    watched_ms_ = 0;
}

// speed = full speed × (duty − dead band) / (1 − dead band), solved for the unknown one.
void Actuator::learn(uint16_t travel_um, uint16_t ms) {
    const float mm_s = static_cast<float>(travel_um) / ms;
    const bool at_full = watched_ == FULL || watched_ == -FULL;
    if (at_full) {
        if (mm_s < LEAST_FULL_MM_S || mm_s > MOST_FULL_MM_S) return;
        const float weight = full_known_ ? travel_um / (travel_um + SURE_TRAVEL_UM) : 1;
        full_mm_s_ += weight * (mm_s - full_mm_s_);
        full_known_ = true;
        return set_slope();
    }
    const float share = mm_s / full_mm_s_;
    if (share > 0.9f) return;
    const float band = (size_of(watched_) - FULL * share) / (1 - share);
    if (band >= 0 && band <= MOST_DEAD_BAND) dead_band_ = static_cast<uint16_t>(band + 0.5f);
    set_slope();
}
