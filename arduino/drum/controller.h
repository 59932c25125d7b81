// Controls the drum: follows the state table, supervises it, and moves each state to its end.
//
// It is called with each load-cell conversion and once a millisecond, never from an interrupt.
#ifndef CONTROLLER_H
#define CONTROLLER_H

#include <stdint.h>

#include "actuator.h"       // speed to duty
#include "axis.h"           // the drum's motions
#include "bank.h"           // settings
#include "commission.h"     // are they those of the set-up
#include "contact.h"        // is the drum lifted
#include "force_control.h"  // contact force
#include "force_sensor.h"   // samples
#include "heartbeat.h"      // is the computer alive
#include "machine.h"        // states
#include "motion_watch.h"   // does the actuator follow its duty
#include "nudge.h"          // a small motion
#include "signals.h"        // inputs

class Controller {
  public:
    explicit Controller(Bank &bank) : bank_(bank) {}

    // Leaves BOOT, once the settings are in place.
    void boot(bool watchdog_reset);
    void tick(const Inputs &inputs);
    // Takes a conversion and checks it. Returns false while the amplifier still settles.
    bool sample(const Conversion &conversion);
    // Moves the actuator by the newest sample; the checks of sample() do not wait for it.
    void control_force();
    bool control_due() const { return control_due_; }
    // Compares force with motion after a step of the loop; the next tick does it at the latest.
    void watch_force();
    bool watch_due() const { return watch_due_; }

    // Applies the settings in the bank.
    void apply_settings();
    void restore_defaults();
    void take_heartbeat() { heartbeat_.seen(bank_.word(reg::heartbeat)); }

    // Follows an event that the state table accepts.
    void go(Event event);
    bool arm();
    bool clear_fault();
    // Moves the actuator a little out of IDLE; false where it may not.
    bool begin_nudge(bool presses);

    // Causes of faults that are present now, one bit per fault.
    uint32_t causes() const;
    bool resting() const;
    // Lifts slowly: nobody has said yet that the wires are right.
    bool gentle() const { return !commission_.holds(); }
    // Nothing but the way of an approach may show that the load cell feels nothing.
    bool cell_trusted() const {
        return sensor_.feels() || (commission_.holds() && !contact_.other_drum());
    }
    // The approach is bounded by the place of an earlier boot, where nothing else bounds it.
    void recall_place();
    // Keeps the place of contact for the next boot, where it is another one.
    void keep_place() const;
    // Returns whether settings that give a force its meaning, or stop it, may change.
    bool may_change(Guard guard) const;

    const Machine &machine() const { return machine_; }
    const Heartbeat &heartbeat() const { return heartbeat_; }
    const Signals &signals() const { return signals_; }
    const Commission &commission() const { return commission_; }
    const Actuator &actuator() const { return actuator_; }
    const Nudge &nudge() const { return nudge_; }
    const MotionWatch &motion() const { return motion_; }
    ForceSensor &sensor() { return sensor_; }
    const ForceSensor &sensor() const { return sensor_; }
    Axis &axis() { return axis_; }
    const Axis &axis() const { return axis_; }
    Contact &contact() { return contact_; }
    const Contact &contact() const { return contact_; }
    ForceControl &force_control() { return force_control_; }
    const ForceControl &force_control() const { return force_control_; }
    // Duty of the actuator in permille, positive presses.
    int16_t duty() const { return duty_; }

  private:
    bool needs_restart() const;
    void supervise();
    void raise(Fault fault);
    void raise_off(Fault fault);
    void enter(State state);
    void drive_actuator();
    void watch_index();
    void watch_motion();
    bool lifts_surely() const;
    void watch_unlimited_force();
    void watch_gentle_nudge();
    void progress();
    void selftest();
    void approach();
    void lift();
    void nudge_on();
    int32_t place_tare() const;
    void watch_contact();
    uint32_t in_state_ms() const { return signals_.now_ms() - entered_ms_; }

    Bank &bank_;
    Machine machine_;
    Heartbeat heartbeat_;
    Signals signals_;
    ForceSensor sensor_;
    Axis axis_{bank_};
    Contact contact_{sensor_, signals_};
    ForceControl force_control_{bank_, signals_, sensor_, axis_, contact_};
    Actuator actuator_;
    Commission commission_;
    Nudge nudge_;
    MotionWatch motion_;
    uint32_t entered_ms_ = 0;
    State entered_ = State::Boot;
    int16_t duty_ = 0;
    // Raw reading when the actuator first moved since the boot, or last moved in a known direction, and
    // the least loaded one since the first motion.
    int32_t first_raw_ = 0, least_raw_ = 0;
    bool moved_ = false;
    bool lift_pressed_ = false;  // and nothing since then has shown what lifts
    bool watch_due_ = false;    // the force loop has made a step
    bool control_due_ = false;  // a sample has come that the force loop has not seen
};

#endif  // CONTROLLER_H
