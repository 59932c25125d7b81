// The board's header, or the one that the build names, and constants derived from it.
#ifndef VARIANT_H
#define VARIANT_H

#ifdef VARIANT
#include VARIANT
#else
#include "board.h"
#endif

#include "drum_map.h"  // the band in which scales lie

#ifndef BUILD_HASH
#define BUILD_HASH 0UL  // the Arduino IDE passes none
#endif

namespace board {

constexpr uint8_t FIRMWARE_MAJOR = 0;
constexpr uint8_t FIRMWARE_MINOR = 1;

constexpr uint32_t CLOCK_HZ = 16000000UL;
constexpr uint32_t NM_PER_STEP = NM_PER_TURN / STEPS_PER_TURN;

// How fast the actuator lifts before the board is commissioned: decision 0040 derives it.
constexpr float GENTLE_LIFT_MM_S = ACTUATOR_MAX_MM_S < 2.5f ? ACTUATOR_MAX_MM_S : 2.5f;

// Grams as counts of the load cell that the board is built for.
constexpr int32_t counts_of(uint16_t grams) { return grams * 1000000LL / UG_PER_COUNT; }
constexpr int32_t MOST_COUNTS = counts_of(MOST_FORCE_G);

static_assert(NM_PER_TURN % STEPS_PER_TURN == 0, "a step must be whole nanometres");
static_assert(STEPS_PER_TURN % 256 == 0 && STEPS_PER_TURN <= 32512,
              "the drum's angle has 256 parts of a turn, its place 15 bits");
static_assert(LOADCELL_SLOW_PERIOD_US <= 100000, "slower than any rate of the HX711");
static_assert(UG_PER_COUNT >= SCALE_LEAST_UG && UG_PER_COUNT <= SCALE_MOST_UG,
              "no load cell on an HX711 counts so");
static_assert(MOST_COUNTS < 0x600000, "the cell's range ends before the limit does");

}  // namespace board

#endif  // VARIANT_H
