/* The digital pins: inputs that change at set cycles, outputs with cycle stamps. */
#ifndef RIGCTL_SIM_PINS_H
#define RIGCTL_SIM_PINS_H

#include "sim.h"

struct pin_queue {
    uint64_t cycle[SIM_MAX_INPUTS * 2];
    uint8_t signal[SIM_MAX_INPUTS * 2], level[SIM_MAX_INPUTS * 2];
    uint32_t head, tail;
};

struct pins {
    struct pin_queue queue;
    uint8_t out_level[8];                  /* per enum sim_output */
    uint8_t pull_mask[16], pull_value[16]; /* per port letter A … P */
};

void pins_open(sim_board *board);
void pins_restore(sim_board *board);
void pins_begin(sim_board *board);
uint64_t pins_next(const sim_board *board);
void pins_run(sim_board *board, uint64_t now);
void pins_set(sim_board *board, char port, int bit, int level);
void pins_on_output(sim_board *board, int signal, int level);

#endif
