// A table of 256 entries in flash: 27 bytes in about 1,000 cycles, a bit by bit loop takes 8,000.
#include "crc32.h"

#ifdef __AVR__
#include <avr/pgmspace.h>
#else
#define PROGMEM
#define pgm_read_dword(address) (*(address))
#endif

namespace {

constexpr uint32_t entry(uint32_t value, uint8_t bits) {
    return bits == 0 ? value : entry((value & 1) ? (value >> 1) ^ 0xedb88320UL : value >> 1, bits - 1);
}

#define E1(n) entry(n, 8)
#define E4(n) E1(n), E1(n + 1), E1(n + 2), E1(n + 3)
#define E16(n) E4(n), E4(n + 4), E4(n + 8), E4(n + 12)
#define E64(n) E16(n), E16(n + 16), E16(n + 32), E16(n + 48)

const uint32_t TABLE[256] PROGMEM = {E64(0), E64(64), E64(128), E64(192)};

}  // namespace

uint32_t crc32(const uint8_t *bytes, uint8_t size) {
    uint32_t crc = 0xffffffffUL;
    while (size--) crc = pgm_read_dword(&TABLE[uint8_t(crc) ^ *bytes++]) ^ (crc >> 8);
    return ~crc;
}
