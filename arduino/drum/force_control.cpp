#include "force_control.h"

#include <math.h>

#include "variant.h"  // speeds of the actuator

namespace {

// Above the last contact: slowing down takes 0.9 mm, and begins with a sample.
constexpr uint16_t SLOW_ZONE_UM = 1400, US_PER_UM = 125;
constexpr float SEARCH_MM_S = 3.0f;        // near the surface, at most
// The search is so slow that the set force would take this time, and these periods, to build up.
constexpr float SEARCH_S = 0.08f, SEARCH_PERIODS = 1.6f;
constexpr float QUICK_MM_S = board::ACTUATOR_MAX_MM_S < 8 ? board::ACTUATOR_MAX_MM_S : 8.0f;
constexpr float CONTACT_MM_S = board::ACTUATOR_MAX_MM_S < 6 ? board::ACTUATOR_MAX_MM_S : 6.0f;
constexpr float SETUP_MM_S = 1.0f;         // nothing is known yet of cell and actuator
constexpr int16_t LEAST_WIDE_DG = 150;
constexpr int16_t SURE_DG = 1500;          // no shock and no noise
constexpr float DEPTH_GAIN = 4.0f;         // 1/s
constexpr float DEPTH_REST_MM = 0.03f;     // the potentiometer shows 0.05 mm a count
constexpr float DEPTH_BAND_MM = 0.06f;

float limited_dg(float force_g) {
    return force_g > 3200.0f ? 32000.0f : force_g < -3200.0f ? -32000.0f : force_g * 10;
}

}  // namespace

// Computes here what each sample needs: a floating-point product takes 10 µs.
void ForceControl::configure() {
    loop_.configure(sampling());
    contact_watch_.configure(sampling());
    steadiness_.configure(sampling());
    const float force_g = bank_.word(reg::force_set) * 0.1f;
    if (force_g != target_.force_g) {
        contact_watch_.restart();
        steadiness_.restart();
    }
    target_ = {force_g, bank_.word(reg::gain_p) * 0.01f, bank_.word(reg::gain_i) * 0.01f, 0};
    band_g_ = force_g * bank_.word(reg::settle_band) * 0.001f;
}

void ForceControl::begin(bool for_setup) {
    for_setup_ = for_setup;
    touched_ = sure_ = false;
    contact_watch_.restart();
    start_um_ = signals_.position_um();
    locked_ = false;
    loop_.begin(bank_.word(reg::stiffness_g_per_mm));
}

void ForceControl::reached() {
    locked_ = mode() == ForceMode::Lock;
    contact_.remember_place();
    steadiness_.restart();
}

float ForceControl::step() {
    const bool searching = !loop_.in_contact();
    target_.speed_limit = for_setup_ ? SETUP_MM_S : CONTACT_MM_S;
    if (searching) target_.speed_limit = contact_.close(slow_zone_um()) ? search_speed() : QUICK_MM_S;
    float speed = loop_.update(sensor_.force_g(), target_, axis_.turn());
    if (searching && loop_.in_contact()) {
        outside_ms_ = signals_.now_ms();
        if (!touched_) contact_ms_ = outside_ms_;
        touched_ = true;
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
    const float speed = depth_mm / (SEARCH_S + SEARCH_PERIODS * sampling().period_s);
    const float most = for_setup_ ? SETUP_MM_S : SEARCH_MM_S;
    return speed < most ? speed : most;
}

// A fifth of the set force away, where the narrow band of the settings is for the trial's verdict.
bool ForceControl::unsteady() {
    const int16_t set_dg = bank_.word(reg::force_set);
    const int16_t wide_dg = set_dg / 5 > LEAST_WIDE_DG ? set_dg / 5 : LEAST_WIDE_DG;
    const int16_t off_dg = force_dg_ > set_dg ? force_dg_ - set_dg : set_dg - force_dg_;
    return steadiness_.lost(off_dg > wide_dg);
}

Fault ForceControl::watch(bool holding, bool turning) {
    force_dg_ = static_cast<int16_t>(limited_dg(sensor_.force_g()));
    const int16_t wanted_dg = bank_.word(reg::force_set);
    const int16_t sure_dg = wanted_dg / 2 < SURE_DG ? wanted_dg / 2 : SURE_DG;
    if (loop_.in_contact() && force_dg_ >= sure_dg) sure_ = true;
    if (contact_watch_.pulls(force_dg_, for_setup_)) return Fault::ForceUnexplained;
    const uint16_t most_um = for_setup_ ? ContactWatch::SETUP_BEYOND_UM : ContactWatch::BEYOND_UM;
    if (!loop_.in_contact()) return contact_.too_deep(most_um) ? Fault::TooDeep : Fault::None;
    const bool by_force = mode() == ForceMode::Hold && !step_test_.running();
    if (holding && by_force && unsteady()) return Fault::ForceUnsteady;
    if (!signals_.reads_position()) return Fault::None;
    const int16_t set_dg = mode() == ForceMode::Position ? INT16_MAX : wanted_dg;
    const bool settled = holding && within_band();
    const Fault found = contact_watch_.check({signals_.position_um(), contact_.contact_um(), force_dg_,
                                              set_dg, turning, settled, for_setup_});
    if (found != Fault::ForceMissing || sure_) return found;
    // A shock in the air was taken for the contact.
    contact_watch_.restart();
    loop_.begin(bank_.word(reg::stiffness_g_per_mm));
    return Fault::None;
}

uint16_t ForceControl::slow_zone_um() const {
    return SLOW_ZONE_UM + static_cast<uint16_t>(sampling().period_us / US_PER_UM);
}

// The settings' time, but long enough for samples to show it.
uint16_t ForceControl::settle_ms() const {
    const uint16_t set = bank_.word(reg::settle_time_ms);
    return set > sampling().settle_ms ? set : sampling().settle_ms;
}

bool ForceControl::finds_nothing(uint32_t searching_ms) const {
    const uint16_t limit = bank_.word(reg::approach_limit_um);
    const bool too_far = signals_.reads_position() &&
                         signals_.position_um() > static_cast<uint32_t>(start_um_) + limit;
    return too_far || searching_ms > limit / (0.5f * search_speed()) + 500;
}

bool ForceControl::settled() const {
    return signals_.now_ms() - outside_ms_ >= settle_ms();
}

bool ForceControl::settles_too_late() const {
    return signals_.now_ms() - contact_ms_ > bank_.word(reg::approach_timeout_ms);
}
