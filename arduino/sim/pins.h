/* The digital pins: inputs that change at set cycles, outputs with cycle stamps. */
#ifndef RIGCTL_SIM_PINS_H
#define RIGCTL_SIM_PINS_H

#include "avr_ioport.h"
#include "chip.h"

struct pin_queue {
    uint64_t cycle[SIM_MAX_INPUTS * 2];
    uint8_t signal[SIM_MAX_INPUTS * 2], level[SIM_MAX_INPUTS * 2];
    uint32_t head, tail;
};

struct pins {
    struct chip *chip;
    void (*on_clock)(void *param, int level); /* the load cell's clock has a new level */
    void *clock_param;
    struct pin_queue queue;
    uint8_t out_level[8];                  /* per enum sim_output */
    uint8_t pull_mask[16], pull_value[16]; /* per port letter A … P */
};

void pins_open(struct pins *pins, struct chip *chip);
void pins_float(struct pins *pins);
void pins_restore(struct pins *pins);
void pins_begin(struct pins *pins);
uint64_t pins_next(const struct pins *pins);
void pins_run(struct pins *pins, uint64_t now);
void pins_set(struct pins *pins, char port, int bit, int level);

#endif
