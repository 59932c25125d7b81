// The serial port: a transmit ring for three frames, a small receive ring, both by interrupt.
#ifndef CHIP_SERIAL_H
#define CHIP_SERIAL_H

#include "ports.h"

void serial_begin();

#endif  // CHIP_SERIAL_H
