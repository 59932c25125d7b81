// The serial port: a transmit ring for three frames, a small receive ring, both by interrupt.
#ifndef TAXELS_CHIP_SERIAL_H
#define TAXELS_CHIP_SERIAL_H

#include <stdint.h>

void serial_begin();

// Queues a whole frame, or nothing. Returns false when the ring has no room for all of it and
// as many bytes more as are to be kept free behind it.
bool serial_send(const uint8_t *bytes, uint8_t size, uint8_t kept_free);

// Takes one received byte. Returns false when there is none.
bool serial_receive(uint8_t &byte);

#endif
