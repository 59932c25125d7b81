/* Voltages and conductances that a caller gives: linear between the rows of a slice. */
#ifndef RIGCTL_SIM_VOLTAGE_H
#define RIGCTL_SIM_VOLTAGE_H

#include "chip.h"

double analog_input(const struct chip *chip, int channel);
double analog_noise(const struct chip *chip, int channel); /* in codes of the converter */

#endif
