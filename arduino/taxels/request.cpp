#include "request.h"

#include "cobs.h"
#include "crc32.h"
#include "wire.h"

namespace {

uint8_t type_of(uint8_t *frame, uint8_t size) {
    size = cobs_decode(frame, size);
    if (size != 1 + CRC_SIZE) return 0;
    uint32_t expected = crc32(frame, 1);
    for (uint8_t i = 0; i < CRC_SIZE; i++, expected >>= 8)
        if (frame[1 + i] != uint8_t(expected)) return 0;
    return frame[0] == TYPE_IDENTIFY || frame[0] == TYPE_SELF_TEST ? frame[0] : 0;
}

}  // namespace

uint8_t RequestParser::feed(uint8_t byte) {
    if (byte == 0) {
        uint8_t size = size_;
        size_ = 0;
        return size && size <= sizeof frame_ ? type_of(frame_, size) : 0;
    }
    if (size_ < sizeof frame_) frame_[size_++] = byte;
    else size_ = sizeof frame_ + 1;
    return 0;
}
