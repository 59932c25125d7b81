/* The sensor's lines and inputs, with wiring faults. */
#ifndef RIGCTL_SIM_SENSOR_H
#define RIGCTL_SIM_SENSOR_H

#include "chip.h"

struct sensor {
    struct chip *chip;
    avr_io_read_t read_pins; /* simavr's own reading of port D */
    void *read_param;
};

void sensor_open(struct sensor *sensor, struct chip *chip);
double sensor_share(const struct sensor *sensor, int input);

#endif
