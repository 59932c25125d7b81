/* The HX711 load-cell amplifier. */
#ifndef RIGCTL_SIM_LOADCELL_H
#define RIGCTL_SIM_LOADCELL_H

#include "sim.h"

struct loadcell {
    uint64_t ready_q16;  /* cycle × 65536 at which the next conversion ends */
    uint64_t sck_rise, read_start;
    uint64_t offered;    /* cycle at which the held conversion was offered */
    int32_t held;        /* conversion offered to the reader */
    int32_t last;        /* last conversion, for the frozen mode */
    int settling;        /* conversions to discard */
    int pulses;          /* clock rises of the present read, 0: none */
    int gain_pulses;     /* pulses that selected the gain of the next conversion */
    int sck, dout, down;
};

void loadcell_open(sim_board *board);
uint64_t loadcell_next(const sim_board *board);
void loadcell_run(sim_board *board, uint64_t now);
void loadcell_clock(sim_board *board, int level);
void loadcell_restore(sim_board *board);

#endif
