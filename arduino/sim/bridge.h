/* The H-bridge of the actuator. */
#ifndef RIGCTL_SIM_BRIDGE_H
#define RIGCTL_SIM_BRIDGE_H

#include "sim.h"

struct bridge {
    double duty, sum;  /* present duty, and its integral over the slice */
    uint64_t since;    /* cycle up to which the integral reaches */
};

void bridge_open(sim_board *board);
void bridge_changed(sim_board *board);
void bridge_begin(sim_board *board);
void bridge_end(sim_board *board);

#endif
