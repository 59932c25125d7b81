// The gain of the finger board at the ends of what a request may set.
#include "../native/check.h"
#include "neurons.h"

TEST(the_largest_numbers_of_a_gain_stay_within_32_bits)
{
    for (uint8_t shift : {uint8_t(0), MAX_GAIN_SHIFT}) {
        Neurons neurons;
        neurons.gain.shift = shift;
        for (uint8_t i = 0; i <= GAIN_STEPS; i++) neurons.gain.gains[i] = i % 2 ? MAX_GAIN : 0;
        Sample sample;
        for (uint16_t &reading : sample.reading) reading = 0xFFFF;
        for (uint8_t i = 0; i < 20; i++) neurons.advance(sample);
        CHECK(neurons.gain.at(0) == 0);
        CHECK(neurons.gain.at(int32_t(1) << shift) == MAX_GAIN);
    }
}
