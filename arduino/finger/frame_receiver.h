// Collects the bytes of a line into frames: COBS, CRC-32, closing zero.
#ifndef FINGER_FRAME_RECEIVER_H
#define FINGER_FRAME_RECEIVER_H

#include <stdint.h>

#include "wire.h"

class FrameReceiver {
public:
    // Takes a byte. Returns the size of the body() that it completed, else 0.
    uint8_t feed(uint8_t byte);
    const uint8_t *body() const { return frame_; }

    // Chunks between two zeros that were no whole frame.
    uint32_t damaged() const { return damaged_; }

private:
    uint8_t close(uint8_t size);

    uint8_t frame_[MAX_WIRE];
    uint8_t size_ = 0;
    bool too_long_ = false;
    uint32_t damaged_ = 0;
};

#endif
