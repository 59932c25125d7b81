#include "tare_turn.h"

void TareTurn::begin() {
    for (uint8_t place = 0; place < TARE_PLACES; ++place) sums_[place] = counts_[place] = 0;
    begun_ = false;
}

void TareTurn::add(int32_t raw, uint16_t place_steps) {
    if (!begun_) first_ = raw;
    begun_ = true;
    const uint8_t place = (place_steps + PLACE_STEPS / 2) / PLACE_STEPS % TARE_PLACES;
    sums_[place] += raw - first_;
    ++counts_[place];
}

bool TareTurn::finish() {
    int32_t sum = 0;
    for (uint8_t place = 0; place < TARE_PLACES; ++place) {
        if (counts_[place] < LEAST_READINGS) return false;
        sums_[place] /= counts_[place];
        sum += sums_[place];
    }
    const int32_t mean = sum / TARE_PLACES;
    for (uint8_t place = 0; place < TARE_PLACES; ++place) {
        sums_[place] -= mean;
        if (sums_[place] < -32768 || sums_[place] > 32767) return false;
    }
    mean_ = first_ + mean;
    return true;
}

int32_t TareTurn::between(const uint16_t *table, uint16_t place_steps) {
    constexpr uint32_t SHARE = (65536UL + PLACE_STEPS / 2) / PLACE_STEPS;
    const uint8_t place = place_steps / PLACE_STEPS % TARE_PLACES;
    const int32_t here = static_cast<int16_t>(table[place]);
    const int32_t next = static_cast<int16_t>(table[(place + 1) % TARE_PLACES]);
    const int32_t share = (place_steps % PLACE_STEPS) * SHARE >> 8;
    return here + ((next - here) * share >> 8);
}
