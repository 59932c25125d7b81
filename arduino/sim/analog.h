/* The analog-to-digital converter and its trigger. */
#ifndef RIGCTL_SIM_ANALOG_H
#define RIGCTL_SIM_ANALOG_H

#include "avr_adc.h"
#include "avr_timer.h"
#include "chip.h"
#include "sensor.h"

struct analog {
    struct chip *chip;
    const struct sensor *sensor; /* taxels: what the inputs are connected to */
    avr_adc_t *adc;
    avr_timer_t *timer;   /* taxels: timer 1, which triggers conversions */
    int compare_latched;  /* OCF1B is set and has not been cleared */
    uint64_t triggered;   /* cycle of the compare that starts a conversion, 0: none */
};

void analog_open(struct analog *analog, struct chip *chip, const struct sensor *sensor);

#endif
