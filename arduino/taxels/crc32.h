// CRC-32 as zlib computes it: reflected, polynomial 0xedb88320, start and final XOR all ones.
#ifndef CRC32_H
#define CRC32_H

#include <stdint.h>

uint32_t crc32(const uint8_t *bytes, uint8_t size);

#endif  // CRC32_H
