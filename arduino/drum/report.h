// Fills the readable registers from what the other parts know.
#ifndef REPORT_H
#define REPORT_H

#include <stdint.h>

#include "bank.h"        // where it goes
#include "commands.h"    // results
#include "controller.h"  // states, motion, force
#include "modbus.h"      // counters of the wire

class Report {
  public:
    Report(Bank &bank, const Controller &controller, const Commands &commands,
           const Modbus &modbus)
        : bank_(bank), controller_(controller), commands_(commands), modbus_(modbus) {}

    // Once after a boot.
    void fill_identity();
    // Before each read.
    void refresh();

  private:
    void fill_state();
    void fill_motion();
    void fill_loadcell();
    void fill_counters();
    uint16_t status_bits() const;

    Bank &bank_;
    const Controller &controller_;
    const Commands &commands_;
    const Modbus &modbus_;
};

#endif  // REPORT_H
