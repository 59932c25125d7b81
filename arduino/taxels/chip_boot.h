// What the chip remembers of its resets, and how much stack was never used.
#ifndef CHIP_BOOT_H
#define CHIP_BOOT_H

#include <stdint.h>

#include "ports.h"

// Counts this boot in EEPROM and returns the number. Takes up to 14 ms; call it once, before
// sampling begins. Two places with a check byte each: power lost while writing costs one count.
uint16_t count_boot();

// Frames that nobody took since the watchdog was kicked last. A reset keeps the number: many of them
// mean that the program hung, even where a bootloader has cleared the chip's own record.
extern volatile uint8_t unkicked_frames;

// Call it where the watchdog is switched on.
void watch_begins();

// Looks at the next few bytes; a look at all of them would take a whole frame.
void look_at_stack();

#endif  // CHIP_BOOT_H
