#include "contact_watch.h"

namespace {

// The softest contact that a setting allows, 50 g/mm, gives this force on this way.
constexpr int16_t RISE_DG = 200;
constexpr uint16_t RISE_UM = 400;
// Grooves and run-out of a turning drum.
constexpr uint16_t GROOVES_UM = 1000;
constexpr uint16_t LIFTED_UM = 2000;
constexpr int16_t FELT_DG = 200;
// Nothing that presses makes the drum lighter; a heavy drum that starts quickly does by less.
constexpr int16_t PULLS_DG = -1000;
// Of the set-up, which presses with 100 g at 1 mm/s while the drum stands.
constexpr int16_t SETUP_PULLS_DG = -500, SETUP_RISE_DG = 100;
constexpr uint16_t SETUP_RISE_UM = 150;

}  // namespace

void ContactWatch::restart() { referred_ = was_settled_ = false; }

bool ContactWatch::beyond(uint16_t position_um, uint16_t contact_um, uint16_t most_um) {
    return position_um > static_cast<uint32_t>(contact_um) + most_um;
}

bool ContactWatch::pulls(int16_t force_dg, bool for_setup) {
    const bool before = pulled_;
    pulled_ = force_dg < (for_setup ? SETUP_PULLS_DG : PULLS_DG);
    return before && pulled_;
}

void ContactWatch::refer_to(const Sample &sample) {
    from_um_ = sample.position_um;
    from_dg_ = sample.force_dg;
    referred_ = true;
}

Fault ContactWatch::check(const Sample &sample) {
    if (sample.settled && !was_settled_) {
        was_settled_ = true;
        settled_um_ = sample.position_um;
    }
    const uint16_t beyond_um = sample.for_setup ? SETUP_RISE_UM : BEYOND_UM;
    if (was_settled_ && beyond(sample.position_um, settled_um_, beyond_um)) return Fault::TooDeep;
    const bool lifted = sample.position_um + static_cast<uint32_t>(LIFTED_UM) < sample.contact_um;
    if (lifted && sample.force_dg > FELT_DG) return Fault::ForceUnexplained;
    const bool rose = sample.force_dg - from_dg_ >= (sample.for_setup ? SETUP_RISE_DG : RISE_DG);
    const bool enough = sample.force_dg >= sample.set_dg - sample.set_dg / 5;
    if (!referred_ || rose || enough || sample.position_um <= from_um_) {
        refer_to(sample);
        return Fault::None;
    }
    const uint16_t late_um = sampling_->late_um + (sample.turning ? GROOVES_UM : RISE_UM);
    const uint16_t most_um = sample.for_setup ? SETUP_RISE_UM : late_um;
    return sample.position_um - from_um_ > most_um ? Fault::ForceMissing : Fault::None;
}

void Steadiness::restart() {
    for (uint8_t &part : far_) part = 0;
    sum_ = in_part_ = 0;
}

bool Steadiness::lost(bool far_away) {
    far_[part_] += far_away;
    sum_ += far_away;
    if (++in_part_ == part_samples_) {
        in_part_ = 0;
        part_ = (part_ + 1) % PARTS;
        sum_ -= far_[part_];
        far_[part_] = 0;
    }
    return sum_ > part_samples_ * PARTS / 2;
}
