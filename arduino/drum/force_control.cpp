#include "force_control.h"

#include <math.h>

#include "variant.h"  // speeds of the actuator, sample period

namespace {

// Above the last contact: slowing down takes 0.9 mm, and begins with a sample.
constexpr uint16_t SLOW_ZONE_UM = 1400 + board::LOADCELL_PERIOD_US / 125;
constexpr float SEARCH_MM_S = 3.0f;        // near the surface, at most
// The search is so slow that the set force would take this time to build up.
constexpr float SEARCH_S = (80000 + board::LOADCELL_PERIOD_US * 8 / 5) / 1e6f;
constexpr float QUICK_MM_S = board::ACTUATOR_MAX_MM_S < 8 ? board::ACTUATOR_MAX_MM_S : 8.0f;
constexpr float CONTACT_MM_S = board::ACTUATOR_MAX_MM_S < 6 ? board::ACTUATOR_MAX_MM_S : 6.0f;
constexpr float DEPTH_GAIN = 4.0f;         // 1/s
constexpr float DEPTH_REST_MM = 0.03f;     // the potentiometer shows 0.05 mm a count
constexpr float DEPTH_BAND_MM = 0.06f;

}  // namespace

// Computes here what each sample needs: a floating-point product takes 10 µs.
void ForceControl::configure() {
    const float force_g = bank_.word(reg::force_set) * 0.1f;
    target_ = {force_g, bank_.word(reg::gain_p) * 0.01f, bank_.word(reg::gain_i) * 0.01f, 0};
    band_g_ = force_g * bank_.word(reg::settle_band) * 0.001f;
}

void ForceControl::begin() {
    start_um_ = signals_.position_um();
    locked_ = false;
    loop_.begin(bank_.word(reg::stiffness_g_per_mm));
}

float ForceControl::step() {
    const bool searching = !loop_.in_contact();
    target_.speed_limit = CONTACT_MM_S;
    if (searching) target_.speed_limit = contact_.close(SLOW_ZONE_UM) ? search_speed() : QUICK_MM_S;
    float speed = loop_.update(sensor_.force_g(), target_, axis_.turn());
    if (searching && loop_.in_contact()) {
        contact_ms_ = outside_ms_ = signals_.now_ms();
        contact_.touched();
    }
    if (loop_.in_contact()) speed = in_other_mode(speed);
    if (speed > target_.speed_limit) speed = target_.speed_limit;
    loop_.commanded(speed);
    if (!within_band()) outside_ms_ = signals_.now_ms();
    return speed;
}

// The speed in contact where something other than the force loop decides it.
float ForceControl::in_other_mode(float speed) {
    if (step_test_.running()) return step_test_.sample(sensor_.force_g());
    if (locked_) return 0;
    if (mode() != ForceMode::Position) return speed;
    const float missing = depth_missing_mm();
    return fabsf(missing) < DEPTH_REST_MM ? 0 : DEPTH_GAIN * missing;
}

float ForceControl::depth_missing_mm() const {
    const float wanted = bank_.word(reg::depth_set_um) * 0.001f;
    if (!signals_.reads_position()) return wanted - loop_.depth_mm();
    return wanted - static_cast<float>(contact_.depth_um()) * 0.001f;
}

bool ForceControl::within_band() const {
    if (mode() == ForceMode::Position) return fabsf(depth_missing_mm()) <= DEPTH_BAND_MM;
    return fabsf(sensor_.force_g() - target_.force_g) <= band_g_;
}

// From the first touch to the actuator's stop pass about 60 ms; the way travelled meanwhile must
// stay below the set force, also where the contact is half as stiff again as expected.
float ForceControl::search_speed() const {
    const float depth_mm = target_.force_g / bank_.word(reg::stiffness_g_per_mm);
    const float speed = depth_mm / SEARCH_S;
    return speed < SEARCH_MM_S ? speed : SEARCH_MM_S;
}

bool ForceControl::finds_nothing(uint32_t searching_ms) const {
    const uint16_t limit = bank_.word(reg::approach_limit_um);
    const bool too_far = signals_.reads_position() &&
                         signals_.position_um() > static_cast<uint32_t>(start_um_) + limit;
    return too_far || searching_ms > limit / (0.5f * search_speed()) + 500;
}

bool ForceControl::settled() const {
    return signals_.now_ms() - outside_ms_ >= bank_.word(reg::settle_time_ms);
}

bool ForceControl::settles_too_late() const {
    return signals_.now_ms() - contact_ms_ > bank_.word(reg::approach_timeout_ms);
}
