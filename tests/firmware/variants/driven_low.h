// A taxel board whose lines are driven low, with dividers to 5 V, lines and inputs in another
// order, and no wires to the drum.
#ifndef BOARD_H
#define BOARD_H

#include <stdint.h>

constexpr uint8_t LINES = 3;
constexpr uint8_t INPUTS = 6;
constexpr uint8_t LINE_BIT[LINES] = {6, 5, 4};
constexpr uint8_t INPUT_CHANNEL[INPUTS] = {5, 4, 3, 2, 1, 0};
constexpr bool DRIVE_HIGH = false;
constexpr uint16_t DIVIDER_OHM = 4700;
constexpr bool SYNC_FITTED = false;
constexpr bool INDEX_FITTED = false;
constexpr uint8_t SYNC_MASK = 0x01;
constexpr uint8_t INDEX_MASK = 0x02;
constexpr uint8_t UBRR_VALUE = 3;

#endif  // BOARD_H
