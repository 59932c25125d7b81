/* Time spent in interrupt routines. */
#ifndef RIGCTL_SIM_PROFILE_H
#define RIGCTL_SIM_PROFILE_H

#include "chip.h"

struct profiled_vector {
    struct profile *profile;
    uint8_t vector;
};

struct profile {
    struct chip *chip;
    struct profiled_vector vectors[SIM_VECTORS];
    uint64_t entered[SIM_VECTORS]; /* stack of entry cycles */
    uint8_t vector[SIM_VECTORS];   /* stack of vectors */
    int depth;
    uint64_t off_since;            /* cycle at which interrupts went off, 0: they are on */
};

void profile_open(struct profile *profile, struct chip *chip);
void profile_restore(struct profile *profile);
void profile_instruction(struct profile *profile);

#endif
