/* The HX711 load-cell amplifier. */
#ifndef RIGCTL_SIM_LOADCELL_H
#define RIGCTL_SIM_LOADCELL_H

#include "pins.h"

struct loadcell {
    struct chip *chip;
    struct pins *pins;
    uint64_t ready_q16;  /* cycle × 65536 at which the next conversion ends */
    uint64_t sck_rise, read_start;
    uint64_t offered;    /* cycle at which the held conversion was offered */
    int32_t held;        /* conversion offered to the reader */
    int32_t last;        /* last conversion, for the frozen mode */
    int settling;        /* conversions to discard */
    int pulses;          /* clock rises of the present read, 0: none */
    int gain_pulses;     /* pulses that selected the gain of the next conversion */
    int sck, dout, down;
    int shown;           /* level of DOUT at the chip */
};

void loadcell_open(struct loadcell *cell, struct chip *chip, struct pins *pins);
uint64_t loadcell_next(const struct loadcell *cell);
void loadcell_run(struct loadcell *cell, uint64_t now);
void loadcell_begin(struct loadcell *cell);
void loadcell_clock(struct loadcell *cell, int level);
void loadcell_restore(struct loadcell *cell);

#endif
