/* The analog inputs and the trigger of conversions. */
#ifndef RIGCTL_SIM_ANALOG_H
#define RIGCTL_SIM_ANALOG_H

#include "avr_adc.h"
#include "avr_timer.h"
#include "sim.h"

struct analog {
    avr_adc_t *adc;
    avr_timer_t *timer;   /* taxels: timer 1, which triggers conversions */
    int compare_latched;  /* OCF1B is set and has not been cleared */
    uint64_t triggered;   /* cycle of the compare that starts a conversion, 0: none */
};

void analog_open(sim_board *board);
double analog_share(const sim_board *board, int channel);

#endif
