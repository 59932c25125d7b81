/* The H-bridge of the actuator. */
#ifndef RIGCTL_SIM_BRIDGE_H
#define RIGCTL_SIM_BRIDGE_H

#include "pins.h"

struct bridge {
    struct chip *chip;
    const struct pins *pins;
    double duty, sum;  /* present duty, and its integral over the slice */
    uint64_t since;    /* cycle up to which the integral reaches */
};

void bridge_open(struct bridge *bridge, struct chip *chip, const struct pins *pins);
void bridge_changed(struct bridge *bridge);
void bridge_begin(struct bridge *bridge);
void bridge_end(struct bridge *bridge);

#endif
