/* The sensor's lines and inputs, with wiring faults. */
#ifndef RIGCTL_SIM_SENSOR_H
#define RIGCTL_SIM_SENSOR_H

#include "sim_avr.h"
#include "sim.h"

struct sensor {
    avr_io_read_t read_pins; /* simavr's own reading of port D */
};

void sensor_open(sim_board *board);
int sensor_needs_network(const sim_board *board);
double sensor_share(const sim_board *board, int input);

#endif
