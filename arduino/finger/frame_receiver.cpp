#include "frame_receiver.h"

#include "cobs.h"
#include "crc32.h"

uint8_t FrameReceiver::feed(uint8_t byte)
{
    if (byte == 0) {
        const uint8_t size = too_long_ ? 0 : size_;
        const bool any = too_long_ || size_;
        size_ = 0;
        too_long_ = false;
        const uint8_t body_size = size ? close(size) : 0;
        if (any && !body_size) damaged_++;
        return body_size;
    }
    if (size_ < sizeof frame_) frame_[size_++] = byte;
    else too_long_ = true;
    return 0;
}

uint8_t FrameReceiver::close(uint8_t size)
{
    size = cobs_decode(frame_, size);
    if (size <= CRC_SIZE) return 0;
    const uint8_t body_size = uint8_t(size - CRC_SIZE);
    uint32_t expected = crc32(frame_, body_size);
    for (uint8_t i = 0; i < CRC_SIZE; i++, expected >>= 8)
        if (frame_[body_size + i] != uint8_t(expected)) return 0;
    return body_size;
}
