#include "nudge.h"

#include "variant.h"  // speed and lag of the actuator

namespace {

constexpr uint8_t TICKS_A_PERMILLE = 2;
constexpr uint16_t MOVED_UM = 30;  // above the noise of the reading
// The ramp has gone on since the rod began: while its growing speed made this way, while its lag
// lasted, and 10 ms of the potentiometer.
const float MOVING_MS = __builtin_sqrtf(2000.0f * MOVED_UM * TICKS_A_PERMILLE /
                                        board::ACTUATOR_MAX_MM_S);
const uint16_t LATE_PERMILLE = (MOVING_MS + board::ACTUATOR_LAG_S * 1000 + 10) / TICKS_A_PERMILLE;
constexpr uint16_t MOST_DUTY = 600;  // above any dead band
constexpr uint16_t MOST_UNSEEN_DUTY = 450;  // not faster than the force can end it

}  // namespace

void Nudge::begin(bool presses, uint16_t position_um, bool seen) {
    most_duty_ = seen ? MOST_DUTY : MOST_UNSEEN_DUTY;
    presses_ = presses;
    start_um_ = position_um;
    duty_ = moved_at_ = ticks_ = 0;
    travel_um_ = 0;
    over_ = false;
}

int16_t Nudge::tick(uint16_t position_um) {
    if (over_) return 0;
    travel_um_ = static_cast<int16_t>(position_um - start_um_);
    const uint16_t way = travel_um_ < 0 ? -travel_um_ : travel_um_;
    if (way >= MOVED_UM && !moved_at_) moved_at_ = duty_ > LATE_PERMILLE ? duty_ - LATE_PERMILLE : 1;
    if (way >= TRAVEL_UM || duty_ >= most_duty_) {
        end();
        return 0;
    }
    if (++ticks_ % TICKS_A_PERMILLE == 0) ++duty_;
    return presses_ ? static_cast<int16_t>(duty_) : -static_cast<int16_t>(duty_);
}
