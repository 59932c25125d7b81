// Sampling: timer 1 starts a conversion every 800 cycles by hardware, the interrupts only move
// results. Nothing here waits, and nothing can stretch the millisecond.
#ifndef CHIP_SAMPLING_H
#define CHIP_SAMPLING_H

#include <stdint.h>

#include "ports.h"

void sampling_begin();

// True once a frame has been closed and not been taken yet; interrupts change it.
extern volatile uint8_t frame_closed;

// The frame closed last; valid until the next one is closed, 1 ms later. Clears frame_closed.
const Frame &take_frame();

#endif  // CHIP_SAMPLING_H
