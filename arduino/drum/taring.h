// Tares the load cell: a mean at rest, or one over a turn of the lifted drum.
#ifndef TARING_H
#define TARING_H

#include <stdint.h>

#include "bank.h"        // where the tare goes
#include "controller.h"  // sensor, contact, settings
#include "tare_turn.h"   // tare by angle

class Taring {
  public:
    enum class Progress : uint8_t { Running, Done, Failed };

    Taring(Bank &bank, Controller &controller) : bank_(bank), controller_(controller) {}

    // Begins a tare at rest. One in contact, or far from the zero that the board knows, is refused
    // unless it is `forced`.
    bool begin(bool forced);
    void abandon() { controller_.sensor().loadcell().abandon_tare(); }
    // Once a millisecond, while a tare at rest is the running command.
    Progress tick();

    // The turn of a tare by angle begins.
    void begin_turn();
    // Each sample.
    void sample(int32_t raw);
    // Once a millisecond. Returns Failed when the turn ended and gave no tare.
    Progress tick_turn();

    // The tare was set since the boot, here or by the computer.
    bool tared() const { return tared_; }
    void set_tared(bool tared) { tared_ = tared; }

  private:
    Progress finish();
    bool take_turn();

    Bank &bank_;
    Controller &controller_;
    TareTurn turn_;
    uint8_t tries_ = 0;
    bool forced_ = false;
    bool turning_ = false;
    bool tared_ = false;
};

#endif  // TARING_H
