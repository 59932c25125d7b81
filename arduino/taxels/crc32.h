// CRC-32 as zlib computes it: reflected, polynomial 0xEDB88320, start and final XOR all ones.
#ifndef TAXELS_CRC32_H
#define TAXELS_CRC32_H

#include <stdint.h>

uint32_t crc32(const uint8_t *bytes, uint8_t size);

#endif
