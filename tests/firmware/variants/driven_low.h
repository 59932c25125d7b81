// A taxel board whose lines are driven low, with dividers to 5 V, lines and inputs in another
// order, and no wires to the drum.
#ifndef TAXELS_BOARD_H
#define TAXELS_BOARD_H

#include <stdint.h>

const uint8_t LINES = 3;
const uint8_t INPUTS = 6;
constexpr uint8_t LINE_BIT[LINES] = {6, 5, 4};
constexpr uint8_t INPUT_CHANNEL[INPUTS] = {5, 4, 3, 2, 1, 0};
const bool DRIVE_HIGH = false;
const uint16_t DIVIDER_OHM = 4700;
const bool SYNC_FITTED = false;
const bool INDEX_FITTED = false;
const uint8_t SYNC_MASK = 0x01;
const uint8_t INDEX_MASK = 0x02;
const uint8_t UBRR_VALUE = 3;

#endif
