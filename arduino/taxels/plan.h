// What follows from the board's variant and from the wire; nothing here needs changing.
#ifndef PLAN_H
#define PLAN_H

#ifdef VARIANT
#include VARIANT
#else
#include "board.h"
#endif

constexpr uint8_t FIRMWARE_MAJOR = 1;
constexpr uint8_t FIRMWARE_MINOR = 1;

constexpr uint8_t TAXELS = LINES * INPUTS;
constexpr uint8_t SLOTS = 20;           // the taxels', then at least two for the bandgap
constexpr uint16_t SLOT_CYCLES = 800;   // 20 × 800 cycles are 1 ms exactly
constexpr uint16_t RATE_HZ = 1000;
constexpr uint8_t STATUS_EVERY = 100;   // frames
static_assert(TAXELS <= SLOTS - 2, "the converter reads at most 18 taxels in a millisecond");

constexpr uint8_t mask_of_lines(uint8_t lines) {
    return lines ? uint8_t(1 << LINE_BIT[lines - 1] | mask_of_lines(uint8_t(lines - 1))) : 0;
}
constexpr uint8_t LINE_MASK = mask_of_lines(LINES);
constexpr uint8_t TRANSMIT_MASK = 0x02;
// The rest of port D are unused inputs and the receiver: pulled up, so that none floats. Lines
// that are not driven are held at the dividers' side, never floating.
constexpr uint8_t PORTD_IDLE =
    uint8_t(~(LINE_MASK | TRANSMIT_MASK)) | (DRIVE_HIGH ? 0 : LINE_MASK);

constexpr uint8_t WATCHED_MASK = (SYNC_FITTED ? SYNC_MASK : 0) | (INDEX_FITTED ? INDEX_MASK : 0);

constexpr uint16_t BANDGAP_MV = 1100;
constexpr uint8_t BANDGAP_MUX = 0x0e;

#ifndef BUILD_HASH
#define BUILD_HASH 0UL  // the Arduino IDE does not compute one
#endif

#endif  // PLAN_H
