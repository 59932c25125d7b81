// Consistent Overhead Byte Stuffing for frames shorter than 254 bytes: no zero inside a frame.
#ifndef COBS_H
#define COBS_H

#include <stdint.h>

// Writes size + 1 bytes without a zero, then the closing zero. Returns size + 2.
uint8_t cobs_encode(const uint8_t *body, uint8_t size, uint8_t *wire);

// Decodes what stood between two zeros, in place. Returns the size, or 0 when it is malformed.
uint8_t cobs_decode(uint8_t *frame, uint8_t size);

#endif  // COBS_H
