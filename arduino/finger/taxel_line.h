// The taxel board's data frames on the second serial line (docs/reference/taxel-wire.md).
#ifndef FINGER_TAXEL_LINE_H
#define FINGER_TAXEL_LINE_H

#include <stdint.h>

#include "frame_receiver.h"
#include "neurons.h"

class TaxelLine {
public:
    // Takes a byte. Returns true when it completed a sample; lost() then counts the samples that
    // are missing before it.
    bool feed(uint8_t byte, Sample &sample);
    uint16_t lost() const { return lost_; }
    uint32_t damaged() const { return receiver_.damaged(); }

private:
    FrameReceiver receiver_;
    uint16_t counter_ = 0, lost_ = 0;
    bool synchronised_ = false;
};

#endif
