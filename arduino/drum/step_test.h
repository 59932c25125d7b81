// Measures stiffness and delay by a small step of the actuator while a force is held, and proposes
// gains.
//
// The actuator rests, then lifts at a constant speed for a few samples, then rests again. The
// force falls by stiffness times travel. The area between the force and its end, over the whole
// fall, is half the time of lifting plus everything that delays the force, whatever the shape
// of the response: lag of the actuator, averaging of the cell, time of the loop.
#ifndef STEP_TEST_H
#define STEP_TEST_H

#include <stdint.h>

struct GainProposal {
    float gain_p, gain_i;        // 1/s
    float stiffness_g_per_mm;    // force per commanded travel
    float delay_s;
};

class StepTest {
  public:
    // A force is held at a contact of about this stiffness; `period_s` is that of the samples.
    void begin(float force_g, float stiffness_g_per_mm, float period_s);
    void abandon() { samples_left_ = 0; }
    bool running() const { return samples_left_ != 0; }

    // Takes one load-cell sample; returns the speed to command, mm/s.
    float sample(float force_g);

    // After the end: whether the response is plausible, and the proposal.
    bool succeeded() const { return succeeded_; }
    const GainProposal &proposal() const { return proposal_; }

  private:
    void finish();

    GainProposal proposal_ = {0, 0, 0, 0};
    float before_g_ = 0, after_g_ = 0, sum_g_ = 0;
    float expected_g_ = 0, period_s_ = 0;
    uint8_t samples_left_ = 0, lift_samples_ = 0;
    bool succeeded_ = false;
};

#endif  // STEP_TEST_H
