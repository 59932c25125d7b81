// The serial port: a transmit ring for three frames, a small receive ring, both by interrupt.
#ifndef TAXELS_CHIP_SERIAL_H
#define TAXELS_CHIP_SERIAL_H

#include "ports.h"

void serial_begin();

#endif
