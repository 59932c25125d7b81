#include "force_loop.h"

#include <math.h>

#include "variant.h"  // actuator lag

namespace {

constexpr float LAG_S = board::ACTUATOR_LAG_S;
constexpr float CONTACT_G = 8.0f;     // far above noise, far below any set force
constexpr float COMPRESSION_GAIN = 0.3f;
constexpr float MAX_DRIFT = 1.0f;     // mm/s
constexpr float MAX_RUN_OUT = 0.5f;   // mm
constexpr float PRIOR = 4e-4f;        // mm²: weight of the stiffness believed before
constexpr float FORGETTING = 0.96f;
// A skin found to be stiffer is compressed less by the same force. None of that restated, the drift
// learns it as a surface that recedes, and an approach to deep ridges goes 6 % too far; all of it,
// an approach takes a third longer (plates C and D on the bench).
constexpr float RESTATED = 0.1f;
constexpr float MOVING_MM = 0.004f;   // a period's travel below this says nothing of stiffness
constexpr float TURNING_RAD_S = 0.1f;

float limited(float value, float bound) {
    return value > bound ? bound : value < -bound ? -bound : value;
}

// A turning drum moves the force by its own shape, not by the actuator's travel.
bool turns(const DrumTurn &turn) { return fabsf(turn.rate_rad_s) >= TURNING_RAD_S; }

}  // namespace

// A division costs the chip 35 µs, and each sample would take two.
void ForceLoop::believe(float stiffness_g_per_mm) {
    stiffness_ = stiffness_g_per_mm;
    compliance_ = 1 / stiffness_g_per_mm;
}

void ForceLoop::begin(float stiffness_g_per_mm) {
    believe(stiffness_g_per_mm);
    sum_xx_ = PRIOR;
    sum_xy_ = PRIOR * stiffness_;
    command_ = speed_ = moved_ = shown_ = pending_ = 0;
    compression_ = drift_ = depth_ = 0;
    contact_ = false;
    since_contact_ = 0;
    free_samples_ = 0;
}

void ForceLoop::advance_model() {
    const float pending_before = pending_;
    moved_ = command_ * sampling_->period_s + (speed_ - command_) * sampling_->coast_s;
    speed_ = command_ + (speed_ - command_) * sampling_->decay;
    pending_ = sampling_->late * moved_;
    shown_ = moved_ - pending_ + pending_before;
    depth_ += moved_;
}

void ForceLoop::look_for_contact(float force_g) {
    if (!free_samples_) free_g_ = force_g;
    if (free_samples_ < 255) ++free_samples_;
    if (force_g - free_g_ < CONTACT_G) {
        free_g_ += (force_g - free_g_) * 0.05f;
        return;
    }
    contact_ = true;
    depth_ = compression_ = (force_g - free_g_) * compliance_;
}

void ForceLoop::learn_stiffness(float force_g) {
    if (since_contact_ < 2 || fabsf(shown_) < MOVING_MM) return;
    const float rise = force_g - last_g_;
    sum_xx_ = sum_xx_ * FORGETTING + shown_ * shown_;
    sum_xy_ = sum_xy_ * FORGETTING + shown_ * rise;
    const float estimate = sum_xy_ / sum_xx_;
    if (estimate <= 50 || estimate >= 5000) return;
    const float believed = stiffness_;
    believe(estimate);
    compression_ += RESTATED * (believed * compliance_ - 1) * compression_;
}

// How fast the drum's surface comes towards the skin because it is not round.
float ForceLoop::run_out_rate(const DrumTurn &turn) const {
    return turn.rate_rad_s * (sine_ * turn.cosine - cosine_ * turn.sine);
}

void ForceLoop::correct(float force_g, const DrumTurn &turn) {
    const DrumTurn seen = turn.after(sampling_->seen_s);
    compression_ += shown_ + (drift_ + run_out_rate(seen)) * sampling_->period_s;
    surprise_ = force_g * compliance_ - compression_;
    compression_ += COMPRESSION_GAIN * surprise_;
    // A ridge that passes slowly in a ramp would weigh more than all of the run.
    if (turn.rate_rad_s != last_rate_rad_s_) {
        run_out_gain_ = turns(turn) ? sampling_->run_out_gain / turn.rate_rad_s : 0;
        return;
    }
    if (!turns(turn)) return;
    const float share = run_out_gain_ * surprise_;
    sine_ = limited(sampling_->run_out_kept * sine_ + share * seen.cosine, MAX_RUN_OUT);
    cosine_ = limited(sampling_->run_out_kept * cosine_ - share * seen.sine, MAX_RUN_OUT);
}

void ForceLoop::observe(float force_g, const DrumTurn &turn) {
    advance_model();
    if (!contact_) look_for_contact(force_g);
    else {
        if (since_contact_ < 65535) ++since_contact_;
        if (!turns(turn)) learn_stiffness(force_g);
        correct(force_g, turn);
    }
    last_g_ = force_g;
    last_rate_rad_s_ = turn.rate_rad_s;
}

float ForceLoop::update(float force_g, const ForceTarget &target, const DrumTurn &turn) {
    observe(force_g, turn);
    float speed = target.speed_limit;
    if (contact_) {
        drift_ = limited(drift_ + target.gain_i * surprise_, MAX_DRIFT);
        const float surface = drift_ + run_out_rate(turn.after(LAG_S));
        const float now = compression_ + pending_ + surface * sampling_->delay_s;
        speed = target.gain_p * (target.force_g * compliance_ - now) - surface;
    } else {
        // The cell feels the drum's mass being hurried along and takes it for contact.
        speed = command_ + limited(speed - command_, sampling_->free_step_mm_s);
    }
    command_ = limited(speed, target.speed_limit);
    return command_;
}
