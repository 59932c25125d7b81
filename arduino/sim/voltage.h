/* Voltages that a caller gives: linear between the rows of a slice, as shares of the reference. */
#ifndef RIGCTL_SIM_VOLTAGE_H
#define RIGCTL_SIM_VOLTAGE_H

#include "chip.h"

double input_voltage(const struct chip *chip, int channel);
double input_noise(const struct chip *chip, int channel); /* in codes of the converter */

#endif
