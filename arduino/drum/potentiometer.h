// The actuator's potentiometer: readings of ten bits, smoothed, as a travel.
#ifndef POTENTIOMETER_H
#define POTENTIOMETER_H

#include <stdint.h>

#include "variant.h"  // travel

class Potentiometer {
  public:
    // Once a millisecond.
    void take(uint16_t reading) {
        if (!primed_) smoothed_ = reading * SMOOTHING;
        else smoothed_ += reading - smoothed_ / SMOOTHING;
        primed_ = true;
        raw_ = reading;
    }
    uint16_t raw() const { return raw_; }

    uint16_t position_um() const {
        // A fraction with a power of two below: a division would cost 40 µs a tick.
        constexpr uint16_t TOP = board::POSITION_TOP_RAW * SMOOTHING;
        constexpr uint16_t BOTTOM = board::POSITION_BOTTOM_RAW * SMOOTHING;
        constexpr uint32_t UM_TIMES_1024 = board::ACTUATOR_TRAVEL_UM * 1024ULL / (BOTTOM - TOP);
        if (smoothed_ <= TOP) return 0;
        if (smoothed_ >= BOTTOM) return board::ACTUATOR_TRAVEL_UM;
        return (smoothed_ - TOP) * UM_TIMES_1024 >> 10;
    }

  private:
    static constexpr uint8_t SMOOTHING = 8;

    uint16_t raw_ = 0;
    uint16_t smoothed_ = 0;  // sum of SMOOTHING readings
    bool primed_ = false;
};

#endif  // POTENTIOMETER_H
