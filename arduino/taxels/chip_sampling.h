// Sampling: timer 1 starts a conversion every 800 cycles by hardware, the interrupts only move
// results. Nothing here waits, and nothing can stretch the millisecond.
#ifndef TAXELS_CHIP_SAMPLING_H
#define TAXELS_CHIP_SAMPLING_H

#include <stdint.h>

#include "wire.h"

void sampling_begin();

// True once a frame has been closed and not been taken yet; interrupts change it.
extern volatile uint8_t frame_closed;

// The frame closed last; valid until the next one is closed, 1 ms later. Clears frame_closed.
const Frame &take_frame();

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

#endif
