// Controls the contact: searches it, then holds a force, a depth or the actuator itself.
#ifndef FORCE_CONTROL_H
#define FORCE_CONTROL_H

#include <stdint.h>

#include "axis.h"          // the drum's angle
#include "bank.h"          // set force, gains, mode
#include "contact.h"       // where contact is expected
#include "contact_watch.h" // does the force fit the motion
#include "force_loop.h"    // holds a force
#include "force_sensor.h"  // the force
#include "signals.h"       // the actuator's position
#include "step_test.h"     // measures a contact, proposes gains

class ForceControl {
  public:
    ForceControl(const Bank &bank, const Signals &signals, const ForceSensor &sensor, Axis &axis,
                 Contact &contact)
        : bank_(bank), signals_(signals), sensor_(sensor), axis_(axis), contact_(contact) {}

    void configure();
    // An approach begins; that of the set-up is slow.
    void begin(bool for_setup);
    // One step for the newest sample, in APPROACH, HOLD and RUN. Returns the actuator's speed in
    // mm/s, positive presses.
    float step();
    // The set force was reached: in ForceMode::Lock the actuator rests from now on.
    void reached();
    // After each step: what does not fit, Fault::None where all does.
    Fault watch(bool holding, bool turning);
    void forget_run_out() { loop_.forget_run_out(); }

    ForceMode mode() const { return static_cast<ForceMode>(bank_.word(reg::force_mode)); }
    bool in_contact() const { return loop_.in_contact(); }
    bool within_band() const;
    // The search takes too long or went too far.
    bool finds_nothing(uint32_t searching_ms) const;
    // The force has been inside its band for long enough.
    bool settled() const;
    // Contact is there, but the force takes too long to settle.
    bool settles_too_late() const;

    void begin_step_test() { step_test_.begin(target_.force_g, loop_.stiffness(), sampling().period_s); }
    StepTest &step_test() { return step_test_; }
    const StepTest &step_test() const { return step_test_; }
    const ForceLoop &loop() const { return loop_; }

  private:
    const Sampling &sampling() const { return sampling::of(bank_.word(reg::loadcell_slow)); }
    float search_speed() const;
    bool unsteady();
    uint16_t slow_zone_um() const;
    uint16_t settle_ms() const;
    float depth_missing_mm() const;
    float in_other_mode(float speed);

    const Bank &bank_;
    const Signals &signals_;
    const ForceSensor &sensor_;
    Axis &axis_;
    Contact &contact_;
    ForceLoop loop_;
    StepTest step_test_;
    ForceTarget target_ = {0, 0, 0, 0};
    float band_g_ = 0;
    uint32_t contact_ms_ = 0;  // when contact began first
    uint32_t outside_ms_ = 0;  // when the force was last outside its band
    uint16_t start_um_ = 0;    // the actuator's position when the approach began
    ContactWatch contact_watch_;
    Steadiness steadiness_;
    int16_t force_dg_ = 0;     // newest force, 0.1 g
    bool for_setup_ = false;
    bool touched_ = false;     // this approach has found a contact
    bool sure_ = false;        // and more than a shock
    bool locked_ = false;
};

#endif  // FORCE_CONTROL_H
