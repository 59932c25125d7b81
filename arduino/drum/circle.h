// Sine and cosine of a 256th of a turn, from a quarter of a wave in program memory.
#ifndef CIRCLE_H
#define CIRCLE_H

#include "flash.h"  // constant tables stay in program memory

namespace circle {

// sin(2 pi n / 256) for n = 0 ... 64, times 32767.
constexpr uint16_t QUARTER[65] FLASH = {
    0, 804, 1608, 2410, 3212, 4011, 4808, 5602, 6393, 7179, 7962, 8739, 9512,
    10278, 11039, 11793, 12539, 13279, 14010, 14732, 15446, 16151, 16846, 17530, 18204, 18868,
    19519, 20159, 20787, 21403, 22005, 22594, 23170, 23731, 24279, 24811, 25329, 25832, 26319,
    26790, 27245, 27683, 28105, 28510, 28898, 29268, 29621, 29956, 30273, 30571, 30852, 31113,
    31356, 31580, 31785, 31971, 32137, 32285, 32412, 32521, 32609, 32678, 32728, 32757, 32767,
};

inline float sine(uint8_t part) {
    const uint8_t within = part & 63;
    const bool falling = part & 64, negative = part & 128;
    const float size = flash::word_at(&QUARTER[falling ? 64 - within : within]) * (1.0f / 32767);
    return negative ? -size : size;
}

inline float cosine(uint8_t part) { return sine(part + 64); }

}  // namespace circle

#endif  // CIRCLE_H
