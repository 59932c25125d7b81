// The finger board's variant: what is soldered to it, and all that another wiring would change.
//
// Teensy 4.0 (i.MX RT1062, Cortex-M7 at 600 MHz), 3.3 V. The 3 × 3 taxels reach it in one of two
// ways: through its own converter, or as the taxel board's frames on a second serial line.
#ifndef FINGER_BOARD_H
#define FINGER_BOARD_H

#include <stdint.h>

// True: the taxel board sends the samples to Serial1 (its 5 V line needs a level shifter).
// False: the board's own converter reads them.
const bool TAXEL_BOARD_FITTED = true;

// Which readings of the taxel board are the finger's taxels 1 to 9, row by row: those of the top
// layer in the wiring drawing of arduino/README.md.
constexpr uint8_t TAXEL_READING[9] = {0, 1, 2, 6, 7, 8, 12, 13, 14};
const uint32_t TAXEL_BOARD_BAUD = 500000;

// Without the taxel board: three driven lines cross three analog inputs, dividers to ground.
constexpr uint8_t LINE_PIN[3] = {2, 3, 4};
constexpr uint8_t INPUT_PIN[3] = {14, 15, 16};
const uint16_t SETTLE_US = 20;  // from driving a line to reading it

#endif
