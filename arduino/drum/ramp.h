// Trapezoidal ramps in integer arithmetic, one timer interval per step.
//
// From rest with constant acceleration a, step n falls at t(n) = sqrt(2 n / a). The interval
// before it is therefore first * (sqrt(n) - sqrt(n - 1)) with first = sqrt(2 / a), and the
// same numbers in reverse order slow down. The index into that series is also the number of
// steps a stop takes, so every ramp ends on the exact step with no division anywhere.
// Intervals are timer cycles times 256.
#ifndef RAMP_H
#define RAMP_H

#include <stdint.h>

struct Profile {
    uint32_t first;   // interval scale of the ramp
    uint32_t cruise;  // interval at constant speed
};

namespace ramp {

// Longest index of a ramp; beyond it the drum would cruise below the requested speed.
constexpr uint16_t MAX_INDEX = 60000;

// speed in 0.01 mm/s, acceleration in mm/s²; the board's clock is fast by trim_ppm.
Profile profile(uint16_t speed, uint16_t acceleration, int16_t trim_ppm);

// Interval before the step that follows `index` steps of acceleration.
uint32_t interval(uint32_t first, uint16_t index);

// Steps from rest to the profile's speed.
uint32_t steps_to_speed(uint16_t speed, uint16_t acceleration);

// Surface speed of an interval in 0.01 mm/s; 0 for interval 0.
uint16_t speed_of(uint32_t interval);

}  // namespace ramp

#endif  // RAMP_H
