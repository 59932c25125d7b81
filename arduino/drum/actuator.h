// From a wanted actuator speed to a bridge duty, and back from the potentiometer to travel.
#ifndef ACTUATOR_H
#define ACTUATOR_H

#include <stdint.h>

namespace actuator {

constexpr int16_t FULL = 1000;

// Signed permille for a speed in mm/s; the dead band is jumped, except around standstill.
int16_t duty(float speed_mm_s, uint16_t dead_band_permille);

}  // namespace actuator

#endif  // ACTUATOR_H
