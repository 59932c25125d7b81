// What the taxel board's brain asks of its body: the chip implements it (chip_*.cpp), and so does
// the virtual board on the PC (../host/taxels).
#ifndef PORTS_H
#define PORTS_H

#include <stdint.h>

#include "wire.h"  // status

// --- serial line ---

// Queues a whole frame, or nothing. Returns false when the ring has no room for all of it and
// as many bytes more as are to be kept free behind it.
bool serial_send(const uint8_t *bytes, uint8_t size, uint8_t kept_free);

// Takes one received byte. Returns false when there is none.
bool serial_receive(uint8_t &byte);

// --- sampling ---

// Frames that were closed before the one before them had been taken.
uint16_t missed_frames();

// Fills in what sampling knows: samples, late slots, longest interrupt, sync.
void report_sampling(Status &status);

// Orders for the spare slots, from the next frame on; the answers come with a frame's end.
// What is converted in slot 19: the bandgap, or an input with the lines idle and some inputs'
// pull-ups on. True, and the reading, once the last order was served.
void ask_bandgap();
void ask_input(uint8_t input, uint8_t pulled_inputs);
bool spare_answered(uint16_t &reading);

// Has a line tested once; what all tests since the last call found, a bit a line.
struct LineTest {
    uint8_t low, high, together;
};
void ask_line(uint8_t line);
bool line_answered();
LineTest take_line_tests();

// --- the chip itself ---

// MCUSR as it stood at reset; where a bootloader has cleared it, the copy it left in r2.
uint8_t reset_cause();

// Bytes between the variables and the deepest stack so far, as the last complete look found.
uint16_t free_stack_bytes();

// Share of a frame's millisecond that was waited away.
uint16_t idle_permille();

#endif  // PORTS_H
