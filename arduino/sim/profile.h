/* Time spent in interrupt routines. */
#ifndef RIGCTL_SIM_PROFILE_H
#define RIGCTL_SIM_PROFILE_H

#include "sim.h"

struct profiled_vector {
    sim_board *board;
    uint8_t vector;
};

struct profile {
    struct profiled_vector vectors[SIM_VECTORS];
    uint64_t entered[SIM_VECTORS]; /* stack of entry cycles */
    uint8_t vector[SIM_VECTORS];   /* stack of vectors */
    int depth;
    uint64_t off_since;            /* cycle at which interrupts went off, 0: they are on */
};

void profile_open(sim_board *board);
void profile_restore(sim_board *board);
void profile_instruction(sim_board *board);

#endif
