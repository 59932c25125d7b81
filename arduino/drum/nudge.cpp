#include "nudge.h"

namespace {

constexpr uint8_t TICKS_A_PERMILLE = 2;
constexpr uint16_t MOST_DUTY = 600;  // above any dead band

}  // namespace

void Nudge::begin(bool presses, uint16_t position_um) {
    presses_ = presses;
    start_um_ = position_um;
    duty_ = ticks_ = 0;
    travel_um_ = 0;
    over_ = false;
}

int16_t Nudge::tick(uint16_t position_um) {
    if (over_) return 0;
    travel_um_ = static_cast<int16_t>(position_um - start_um_);
    const uint16_t way = travel_um_ < 0 ? -travel_um_ : travel_um_;
    if (way >= TRAVEL_UM || duty_ >= MOST_DUTY) {
        end();
        return 0;
    }
    if (++ticks_ % TICKS_A_PERMILLE == 0) ++duty_;
    return presses_ ? static_cast<int16_t>(duty_) : -static_cast<int16_t>(duty_);
}
