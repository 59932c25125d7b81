// What the chip remembers of its resets, and how much stack was never used.
#ifndef TAXELS_CHIP_BOOT_H
#define TAXELS_CHIP_BOOT_H

#include <stdint.h>

// MCUSR as it stood at reset; where a bootloader has cleared it, the copy it left in r2.
uint8_t reset_cause();

// Counts this boot in EEPROM and returns the number. Takes up to 14 ms; call it once, before
// sampling begins. Two places with a check byte each: power lost while writing costs one count.
uint16_t count_boot();

// Bytes between the variables and the deepest stack so far, as the last complete look found.
uint16_t free_stack_bytes();

// Looks at the next few bytes; a look at all of them would take a whole frame.
void look_at_stack();

#endif
