#include "finger_board.h"

#include "model.h"

#include <string.h>

void FingerBoard::boot(uint8_t)
{
    io.tx_count = 0;
    taxel_line_ = TaxelLine();
    finger_.reset(new Finger(*this, MODEL));
    finger_->begin();
}

void FingerBoard::run(int32_t samples)
{
    for (int32_t row = 0; row < samples; ++row) {
        Sample sample;
        memcpy(sample.reading, io.readings[row], sizeof sample.reading);
        finger_->take_sample(sample, 0);
    }
}

void FingerBoard::receive_taxels(const uint8_t *bytes, int32_t count)
{
    Sample sample;
    for (int32_t i = 0; i < count; ++i)
        if (taxel_line_.feed(bytes[i], sample)) {
            finger_->set_damaged_frames(taxel_line_.damaged());
            finger_->take_sample(sample, taxel_line_.lost());
        }
}

void FingerBoard::receive(const uint8_t *bytes, int32_t count)
{
    for (int32_t i = 0; i < count; ++i) finger_->receive(bytes[i]);
}

bool FingerBoard::send(const uint8_t *bytes, uint8_t size)
{
    if (io.tx_count + size > MAX_BYTES) {
        ++io.overflows;
        return false;
    }
    memcpy(io.tx + io.tx_count, bytes, size);
    io.tx_count += size;
    return true;
}
