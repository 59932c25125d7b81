// What a self-test reads, and what it makes of it. Knows no register.
#ifndef SELF_TEST_H
#define SELF_TEST_H

#include <stdint.h>

#include "plan.h"  // lines, inputs

// Readings are shares of 1023 from the dividers' side, whichever that is: 0 is no pressure.
struct TestReadings {
    uint8_t lines_low, lines_high, lines_together;  // a bit a line, read back at the pins
    uint16_t rest[INPUTS];    // lines idle
    uint16_t alone[INPUTS];   // the same with this input's pull-up
    uint16_t all[INPUTS];     // the same with the pull-ups of all inputs
    uint16_t driven[TAXELS];  // as sampled, mean of some frames
};

// Bits of SelfTest::tested. What the divider is too small to show, or the polarity, is not.
constexpr uint8_t TESTED_LINES = 1 << 0;
constexpr uint8_t TESTED_OPEN = 1 << 1;    // dividers that are missing
constexpr uint8_t TESTED_SHORTS = 1 << 2;  // inputs connected to ground or to each other
constexpr uint8_t TESTED_TAXELS = 1 << 3;

// A bit a line, an input, a taxel.
struct SelfTest {
    uint8_t count;                                   // tests done since boot, from 1; 0: none yet
    uint8_t tested;
    uint8_t lines_low, lines_high, lines_together;   // stuck, or connected to each other
    uint8_t inputs_high, inputs_low, inputs_open, inputs_together;
    uint32_t silent, full;                           // taxels that never conduct, or always
};

// Everything but the count.
SelfTest judge(const TestReadings &read);

bool found_fault(const SelfTest &test);

#endif  // SELF_TEST_H
