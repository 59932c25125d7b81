/* The stepper motor, the drum and its index mark. */
#ifndef RIGCTL_SIM_MOTOR_H
#define RIGCTL_SIM_MOTOR_H

#include "sim.h"

struct motor {
    int64_t steps;               /* position commanded by the last pulse */
    double from;                 /* position at that pulse */
    uint64_t stepped, interval;  /* cycle of the last pulse, and the time since the one before */
    int index_pin;               /* level of the index mark at the chip */
    int matched;                 /* the compare unit has matched since the last write of OCR1A */
};

void motor_open(sim_board *board);
void motor_place(sim_board *board, int64_t steps);
void motor_step(sim_board *board);
void motor_show_mark(sim_board *board);
void motor_end(sim_board *board);

#endif
