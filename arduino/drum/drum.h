// The drum controller's brain: states, supervision, the commands and what the registers show.
//
// It is called with each load-cell conversion, once a millisecond, and by the Modbus slave;
// never from an interrupt. It moves the world through ports.h only, so it runs on the PC too.
//
// drum.cpp       ticks, samples, supervision, progress of each state
// commands.cpp   what a command needs and starts
// report.cpp     the readable registers
#ifndef DRUM_H
#define DRUM_H

#include <stdint.h>

#include "actuator.h"    // speed to duty
#include "bank.h"        // registers
#include "force_loop.h"  // contact force
#include "heartbeat.h"   // is the computer alive
#include "loadcell.h"    // samples
#include "machine.h"     // states
#include "modbus.h"      // wire counters for the report
#include "ports.h"       // the body
#include "step_test.h"   // gain proposal
#include "tare_turn.h"   // tare by angle
#include "zero.h"        // the lifted drum's reading

struct Inputs {
    uint32_t now_ms;
    uint16_t position_um;
    bool estop_open, end_up, end_down, index_high;
};

class Drum final : public Owner {
  public:
    Drum() : bank_(*this), modbus_(bank_) {}

    // Once after power-up or reset, with what the chip knows.
    void boot(bool watchdog_reset);
    void tick(const Inputs &inputs);
    void sample(const Conversion &conversion);
    // The force loop's step for the newest sample, for which its supervision does not wait.
    void think();
    bool thought_due() const { return thought_due_; }

    Modbus &modbus() { return modbus_; }
    Bank &bank() { return bank_; }
    const Machine &machine() const { return machine_; }
    const ForceLoop &force_loop() const { return force_; }
    const Loadcell &loadcell() const { return loadcell_; }
    CommandResult result() const { return result_; }

    // Owner
    void refresh() override;
    uint16_t ring_word(uint16_t address) override;
    bool may_change(Guard guard) const override;
    bool command(Command command, uint16_t sequence) override;
    void written(uint16_t address, uint16_t count) override;

  private:
    // Whether the drum rests on something: after a boot nobody knows.
    enum class Contact : uint8_t { Gone, Unknown, MayStand };
    // What a long command waits for.
    enum class Pending : uint8_t { None, Change, Tare, Save, Tune };

    // drum.cpp
    uint16_t causes() const;
    void supervise();
    void enter(State state);
    void follow();
    void raise(Fault fault);
    void go(Event event);
    void move_actuator();
    void press();
    float search_speed() const;
    void progress();
    void selftest();
    void approach();
    void lift();
    bool lifted_clear() const;
    bool reads_contact() const;
    bool contact_gone() const;
    void watch_contact();
    void watch_reading();
    void judge_tare();
    bool near_zero(int32_t counts) const { return !zero_.known() || zero_.near(counts); }
    void rewire();
    void position_move();
    void watch_index();
    void finish(CommandResult result);
    void progress_pending();
    void end_tare();
    void end_tare_turn();
    void end_tune();
    void start(const Motion &motion, uint16_t speed);
    DrumTurn turn();
    // As last applied: while a write is judged, its words stand in the bank already.
    bool fitted(Signal signal) const { return fitted_ >> static_cast<uint8_t>(signal) & 1; }
    bool inverted(Signal signal) const { return inverted_ >> static_cast<uint8_t>(signal) & 1; }
    Inputs unwired(const Inputs &inputs) const;
    bool estop_open() const { return fitted(Signal::Estop) && inputs_.estop_open; }
    bool end_up() const { return fitted(Signal::EndSwitches) && inputs_.end_up; }
    bool end_down() const { return fitted(Signal::EndSwitches) && inputs_.end_down; }
    // Both ends at once are wires that are broken or told the wrong way: no drum is lifted by that.
    bool at_upper_end() const {
#ifdef BOTH_ENDS_BELIEVED  // a broken image that the tests must catch
        return end_up();
#endif
        return end_up() && !end_down();
    }
    ForceMode force_mode() const { return static_cast<ForceMode>(word(reg::force_mode)); }
    uint16_t place_in_turn() const;
    float depth_missing_mm() const;
    float other_mode(float speed);
    void touched();
    uint16_t word(uint16_t address) const { return bank_.word(address); }
    bool within_band() const;
    void apply_settings();
    void judge_force();

    // commands.cpp
    bool begin(Command command);
    bool start_state(Event event);
    bool arm();
    bool move();
    bool home();
    bool approach_begin();
    bool run();
    bool clear();
    bool tare(bool anyway);
    bool zero_steps();
    bool tare_turn();
    bool tune();
    bool save();
    bool defaults();
    bool resting() const;
    void restore_defaults();

    // report.cpp
    void report_identity();
    void report_state();
    void report_motion();
    void report_loadcell();
    void report_counters();
    uint16_t status_bits() const;

    Machine machine_;
    Heartbeat heartbeat_;
    Loadcell loadcell_;
    Zero zero_;
    ForceLoop force_;
    Actuator actuator_;
    TareTurn tare_turn_;
    StepTest step_test_;
    Bank bank_;
    Modbus modbus_;
    Inputs inputs_ = {0, 0, false, false, false, false};
    State entered_ = State::Boot;
    uint32_t entered_ms_ = 0;
    uint32_t contact_ms_ = 0;
    uint32_t outside_ms_ = 0;     // last time the force was outside the settle band
    uint16_t start_um_ = 0;       // actuator position at APPROACH
    uint16_t contact_um_ = 0;
    int16_t permille_ = 0;
    uint16_t acknowledged_ = 0;
    CommandResult result_ = CommandResult::None;
    Pending pending_ = Pending::None;
    uint8_t tare_tries_ = 0;
    State pending_goal_ = State::Idle;
    uint16_t index_seen_ = 0;
    int32_t index_expected_ = 0;  // position of the last mark, a multiple of a turn
    int16_t index_error_ = 0;
    bool contact_known_ = false;
    bool thought_due_ = false;    // a sample came, and the force loop has not seen it
    bool locked_ = false;         // force mode 1: the force was reached, the actuator rests
    bool homing_ = false, homed_ = false, tared_ = false;
    bool turning_tare_ = false;   // a turn is made to tare by the angle
    bool tare_by_place_ = false;  // some place of the turn has a tare of its own
    bool tare_anyway_ = false;    // the tare under way was asked for by name
    bool tare_holds_ = false;     // tare_counts lies near the zero that the board knows
    bool backwards_ = false, over_force_ = false;
    Contact contact_ = Contact::Unknown;
    bool lift_failed_ = false;    // the last lift ended, and contact was not seen to be gone
    uint8_t free_run_ = 0;        // readings in a row that show no contact
    uint8_t fitted_ = 0, inverted_ = 0;  // bits of Signal
    ForceTarget target_ = {0, 0, 0, 0};
    float band_g_ = 0, over_force_g_ = 0;
    uint32_t turn_interval_ = 0;  // for which turn_rate_ was worked out
    float turn_rate_ = 0;
    uint16_t cruise_speed_ = 0;   // 0.01 mm/s
};

#endif  // DRUM_H
