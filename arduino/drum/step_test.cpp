#include "step_test.h"

namespace {

constexpr float LIFT_MM_S = 1.0f;      // fast enough to be no pulses, slow enough to be small
constexpr float STEP_SHARE = 0.1f;     // of the force held
constexpr uint8_t REST_SAMPLES = 24, MEAN_SAMPLES = 8, ANSWER_SAMPLES = 40;
constexpr uint8_t LEAST_LIFT = 4, MOST_LIFT = 40;
constexpr float LEAST_STEP_G = 10.0f;
constexpr float LEAST_OF_EXPECTED = 0.2f, MOST_OF_EXPECTED = 5.0f;
constexpr float LEAST_DELAY_S = 0.01f, MOST_DELAY_S = 0.3f;
// Over 1 / delay: a quarter of the gain at which such a loop begins to swing.
constexpr float GAIN_P_TIMES_DELAY = 0.3f;

}  // namespace

void StepTest::begin(float force_g, float stiffness_g_per_mm, float period_s) {
    period_s_ = period_s;
    const float wanted = STEP_SHARE * force_g / (stiffness_g_per_mm * LIFT_MM_S * period_s_);
    lift_samples_ = wanted < LEAST_LIFT ? LEAST_LIFT
                  : wanted > MOST_LIFT  ? MOST_LIFT
                                        : static_cast<uint8_t>(wanted + 0.5f);
    expected_g_ = lift_samples_ * LIFT_MM_S * period_s_ * stiffness_g_per_mm;
    before_g_ = after_g_ = sum_g_ = 0;
    succeeded_ = false;
    samples_left_ = REST_SAMPLES + lift_samples_ + ANSWER_SAMPLES;
}

float StepTest::sample(float force_g) {
    const uint8_t answer = lift_samples_ + ANSWER_SAMPLES;
    if (samples_left_ > answer) {
        if (samples_left_ <= answer + MEAN_SAMPLES) before_g_ += force_g / MEAN_SAMPLES;
    } else {
        sum_g_ += force_g;
        if (samples_left_ <= MEAN_SAMPLES) after_g_ += force_g / MEAN_SAMPLES;
    }
    if (!--samples_left_) finish();
    const bool lifts = samples_left_ <= answer && samples_left_ > ANSWER_SAMPLES;
    return lifts ? -LIFT_MM_S : 0;
}

void StepTest::finish() {
    const uint8_t answer = lift_samples_ + ANSWER_SAMPLES;
    const float fall = before_g_ - after_g_;
    if (fall < LEAST_STEP_G || fall < LEAST_OF_EXPECTED * expected_g_ ||
        fall > MOST_OF_EXPECTED * expected_g_)
        return;
    // A sample is at the end of its period: half a period is missing at the beginning.
    const float area = ((sum_g_ - answer * after_g_) / fall + 0.5f) * period_s_;
    // The hold from one sample to the next adds half a period of delay.
    const float delay = area - (lift_samples_ - 1) * period_s_ * 0.5f;
    if (delay < LEAST_DELAY_S || delay > MOST_DELAY_S) return;
    proposal_.delay_s = delay;
    proposal_.gain_p = GAIN_P_TIMES_DELAY / delay;
    // The slower the loop and the more often it looks, the less of each surprise is the surface's:
    // single ridges pass before they are learned.
    proposal_.gain_i = period_s_ / (delay * delay);
    proposal_.stiffness_g_per_mm = fall / (lift_samples_ * LIFT_MM_S * period_s_);
    succeeded_ = true;
}
