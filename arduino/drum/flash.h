// Constant tables live in program memory on the chip and are plain memory on the PC.
#ifndef FLASH_H
#define FLASH_H

#include <stdint.h>
#include <string.h>

#ifdef __AVR__
#include <avr/pgmspace.h>
#define FLASH PROGMEM
#else
#define FLASH
#endif

namespace flash {

inline uint8_t byte_at(const uint8_t *place) {
#ifdef __AVR__
    return pgm_read_byte(place);
#else
    return *place;
#endif
}

inline uint16_t word_at(const uint16_t *place) {
#ifdef __AVR__
    return pgm_read_word(place);
#else
    return *place;
#endif
}

// Copies one entry of a table out of program memory.
template <typename Entry>
Entry load(const Entry *place) {
    Entry entry;
#ifdef __AVR__
    memcpy_P(&entry, place, sizeof entry);
#else
    memcpy(&entry, place, sizeof entry);
#endif
    return entry;
}

}  // namespace flash

#endif  // FLASH_H
