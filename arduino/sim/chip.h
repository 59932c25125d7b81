/* One simulated chip with the slice that it runs, as its peripherals see it. */
#ifndef RIGCTL_SIM_CHIP_H
#define RIGCTL_SIM_CHIP_H

#include "sim_avr.h"
#include "sim.h"

#define NEVER UINT64_MAX
#define BIT(value, n) ((value) >> (n) & 1)

struct chip {
    avr_t *avr;
    int kind; /* enum sim_kind */
    uint64_t slice_start, slice_end;
    sim_io io;
};

void report_edge(struct chip *chip, int signal, int level);
void report_edge_at(struct chip *chip, uint64_t cycle, int signal, int level);
avr_io_t *find_io(avr_t *avr, const char *kind);

#endif
