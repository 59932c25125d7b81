// The drum controller: joins its parts and serves their registers over Modbus.
//
// It moves hardware through ports.h only, so it also runs on a PC.
//
//   drum          joins the parts below
//   report        fills the readable registers
//   modbus        Modbus RTU server          registers  reads and all-or-nothing writes
//   commands      accepts and ends commands  taring     tares the load cell
//   controller    state table, supervision, progress of each state
//   force_control searches and holds a force
//   axis, contact, force_sensor, signals     motions, is it lifted, contact force, input wires
//   bank          words, bounds and guards of the registers
#ifndef DRUM_H
#define DRUM_H

#include <stdint.h>

#include "bank.h"
#include "commands.h"
#include "controller.h"
#include "modbus.h"
#include "registers.h"
#include "report.h"

class Drum final : public RegisterHandler {
  public:
    // Once after power-up or reset.
    void boot(bool watchdog_reset);
    // Once a millisecond.
    void tick(const Inputs &inputs);
    void sample(const Conversion &conversion);
    // The force loop's step for the newest sample; supervision in sample() does not wait for it.
    void control_force() { controller_.control_force(); }
    bool control_due() const { return controller_.control_due(); }
    void watch_force() { controller_.watch_force(); }
    bool watch_due() const { return controller_.watch_due(); }

    Modbus &modbus() { return modbus_; }
    Registers &registers() { return registers_; }
    const Bank &bank() const { return bank_; }
    const Machine &machine() const { return controller_.machine(); }
    const Loadcell &loadcell() const { return controller_.sensor().loadcell(); }
    CommandResult result() const { return commands_.result(); }

    // RegisterHandler
    void refresh() override { report_.refresh(); }
    uint16_t ring_word(uint16_t address) override;
    bool may_change(Guard guard) const override { return controller_.may_change(guard); }
    bool command(Command command, uint16_t sequence) override {
        return commands_.start(command, sequence);
    }
    void written(uint16_t address, uint16_t count) override;

  private:
    Bank bank_;
    Controller controller_{bank_};
    Commands commands_{bank_, controller_};
    Registers registers_{bank_, *this};
    Modbus modbus_{registers_};
    Report report_{bank_, controller_, commands_, modbus_};
};

#endif  // DRUM_H
