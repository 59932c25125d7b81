// What the program knows of its last reset, the watchdog, and the stack that was never used.
//
// The drum's and the taxel board's folder hold the same chip_reset.h and chip_reset.cpp, because the
// Arduino IDE builds a folder without looking outside of it. A test compares them.
#ifndef CHIP_RESET_H
#define CHIP_RESET_H

#include <stdint.h>

namespace reset {

// Bits of MCUSR. Where a bootloader has cleared them, only WDRF for a program that hung is left.
uint8_t cause();
bool was_watched();  // before that reset

void watch();        // switches the watchdog on: 64 ms, less than the 100 ms in which a hang must end
void kick();

extern volatile uint8_t unkicked_ms;
inline void count_ms_in_isr() { unkicked_ms = unkicked_ms + 1; }

}  // namespace reset

namespace stack {

void begin();  // a whole look, which takes milliseconds

// Continues the next look for so many bytes, or to the deepest trace of the stack.
void look(uint8_t bytes);

// Bytes between the variables and the deepest stack, as the last complete look found.
uint16_t unused_bytes();

}  // namespace stack

#endif  // CHIP_RESET_H
