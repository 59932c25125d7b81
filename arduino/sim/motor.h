/* The stepper motor, the drum and its index mark. */
#ifndef RIGCTL_SIM_MOTOR_H
#define RIGCTL_SIM_MOTOR_H

#include "pins.h"

struct motor {
    struct chip *chip;
    struct pins *pins;
    double steps;                /* position commanded by the last pulse */
    double from;                 /* position at that pulse */
    uint64_t stepped, interval;  /* cycle of the last pulse, and the time since the one before */
    int index_pin;               /* level of the index mark at the chip */
    int matched;                 /* the compare unit has matched since the last write of OCR1A */
};

void motor_open(struct motor *motor, struct chip *chip, struct pins *pins);
void motor_place(struct motor *motor, int64_t steps);
void motor_show_mark(struct motor *motor);
void motor_end(struct motor *motor);

#endif
