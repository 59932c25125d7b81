// Holds a contact force by moving the actuator, once per load-cell sample.
//
// The loop thinks in millimetres of compression: force over stiffness. The actuator is a speed
// source with a lag, so a model of it gives its travel since the moment of the newest sample;
// the loop acts on the present compression, not on the measured one. What the model cannot explain
// is learned as a rate of the surface: a slow part, which is the integral
// action, and one period per drum turn, which is the run-out and is known by the drum's angle.
// The model sees the limited command, so nothing winds up.
//
// Gains are scaled by the stiffness, and the stiffness is estimated while the force rises.
#ifndef FORCE_LOOP_H
#define FORCE_LOOP_H

#include <stdint.h>

#include "sampling.h"  // period and delay of a sample

struct ForceTarget {
    float force_g;
    float gain_p;       // 1/s: speed of approach per compression missing
    float gain_i;       // 1/s²: how fast an unexplained rate is learned
    float speed_limit;  // mm/s
};

// The drum's angle and angular speed.
struct DrumTurn {
    float cosine, sine;  // of its angle
    float rate_rad_s;

    // The same drum a short time later or, with a negative time, earlier.
    DrumTurn after(float seconds) const {
        const float angle = rate_rad_s * seconds;
        return {cosine - angle * sine, sine + angle * cosine, rate_rad_s};
    }
};

class ForceLoop {
  public:
    void configure(const Sampling &sampling) { sampling_ = &sampling; }
    // Free of contact, before pressing down.
    void begin(float stiffness_g_per_mm);
    // One load-cell sample; returns the actuator speed in mm/s, positive presses.
    float update(float force_g, const ForceTarget &target, const DrumTurn &turn);
    // Updates the model while another mode decides the speed.
    void observe(float force_g, const DrumTurn &turn);
    // The speed that was really commanded to the actuator.
    void commanded(float speed_mm_s) { command_ = speed_mm_s; }
    // The drum's angle has a new zero: discards what was learned by angle.
    void forget_run_out() { cosine_ = sine_ = 0; }

    bool in_contact() const { return contact_; }
    float stiffness() const { return stiffness_; }
    // Travel since contact as the model knows it, mm.
    float depth_mm() const { return depth_; }

  private:
    void believe(float stiffness_g_per_mm);
    void advance_model();
    void look_for_contact(float force_g);
    void learn_stiffness(float force_g);
    void correct(float force_g, const DrumTurn &turn);
    float run_out_rate(const DrumTurn &turn) const;

    const Sampling *sampling_ = &sampling::FAST;
    float command_ = 0, speed_ = 0;        // mm/s, commanded and modelled
    float moved_ = 0;                      // mm in the last period
    float shown_ = 0, pending_ = 0;        // mm that the sample shows, and does not show yet
    float free_g_ = 0, last_g_ = 0;
    float compression_ = 0, drift_ = 0;    // mm, mm/s
    float surprise_ = 0;                   // mm, what the model did not foresee
    float cosine_ = 0, sine_ = 0;          // run-out, mm
    float stiffness_ = 600, compliance_ = 1 / 600.0f;  // g/mm, mm/g
    float sum_xx_ = 0, sum_xy_ = 0;
    float depth_ = 0;
    uint16_t since_contact_ = 0;
    float last_rate_rad_s_ = 0, run_out_gain_ = 0;  // the gain is worked out once a speed
    uint8_t free_samples_ = 0;
    bool contact_ = false;
};

#endif  // FORCE_LOOP_H
