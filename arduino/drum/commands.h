// The commands: what each needs before it is accepted, what it starts, and when it is done.
#ifndef COMMANDS_H
#define COMMANDS_H

#include <stdint.h>

#include "bank.h"        // settings, proposals
#include "controller.h"  // states, motions, force
#include "taring.h"      // tares

class Commands {
  public:
    Commands(Bank &bank, Controller &controller)
        : bank_(bank), controller_(controller), taring_(bank, controller) {}

    // Starts a command, or refuses it and changes nothing.
    bool start(Command command, uint16_t sequence);
    // Once a millisecond, behind the controller's tick.
    void tick();
    // Each sample.
    void sample(int32_t raw) { taring_.sample(raw); }
    // The computer wrote the tare.
    void tare_written() { taring_.set_tared(true); }

    // Sequence of the last command that was accepted, and what became of it.
    uint16_t acknowledged() const { return acknowledged_; }
    CommandResult result() const { return result_; }
    bool tared() const { return taring_.tared(); }

  private:
    // What a long command waits for.
    enum class Pending : uint8_t { None, Change, Move, Tare, Save, Tune };

    bool begin(Command command);
    bool follow(Event event);
    bool move();
    bool home();
    bool approach();
    bool approach_setup();
    bool press(bool for_setup);
    bool nudge();
    bool commission();
    bool run();
    bool tare(bool forced);
    bool tare_turn();
    bool tune();
    bool zero_steps();
    bool save();
    bool defaults();
    void finish(CommandResult result);
    void finish(Taring::Progress progress);
    void progress_change(bool done_well);
    void end_tune();

    Bank &bank_;
    Controller &controller_;
    Taring taring_;
    uint16_t acknowledged_ = 0;
    CommandResult result_ = CommandResult::None;
    Pending pending_ = Pending::None;
    State goal_ = State::Idle;  // of a change of state
};

#endif  // COMMANDS_H
