#include "taxel_line.h"

#include "board.h"

namespace {

const uint8_t DATA = 0x11, DATA_SIZE = 27, READINGS_AT = 4, READING_BITS = 10;

// A frame that is not newer than the newest by this many is a repeated or late one. A taxel board
// that started anew is further behind, unless it had run for less than these milliseconds.
const uint16_t LATE_FRAMES = 16;

uint16_t reading(const uint8_t *body, uint8_t index)
{
    const uint16_t bit = uint16_t(index * READING_BITS);
    const uint8_t *at = body + READINGS_AT + bit / 8;
    return (uint16_t(at[0] | at[1] << 8) >> (bit % 8)) & 0x3FF;
}

}  // namespace

bool TaxelLine::feed(uint8_t byte, Sample &sample)
{
    const uint8_t size = receiver_.feed(byte);
    const uint8_t *body = receiver_.body();
    if (size != DATA_SIZE || body[0] != DATA) return false;
    const uint16_t counter = uint16_t(body[1] | body[2] << 8);
    if (synchronised_ && uint16_t(counter_ - counter) < LATE_FRAMES) return false;
    lost_ = synchronised_ ? uint16_t(counter - counter_ - 1) : 0;
    counter_ = counter;
    synchronised_ = true;
    for (uint8_t i = 0; i < TAXELS; i++) sample.reading[i] = reading(body, TAXEL_READING[i]);
    return true;
}
