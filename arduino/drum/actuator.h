// Converts a speed to a bridge duty, for an actuator that does not move below a dead band.
//
// Speeds above PULSE_MM_S are a duty. Slower ones are pulses of that speed, as many as give the
// travel: a duty near the dead band would stick or jump, and the force loop with it. The
// potentiometer measures dead band and full speed whenever one duty lasts long enough.
#ifndef ACTUATOR_H
#define ACTUATOR_H

#include <stdint.h>

#include "variant.h"  // speed at full duty

class Actuator {
  public:
    static constexpr int16_t FULL = 1000;
    static constexpr float PULSE_MM_S = 0.8f;
    static constexpr uint8_t PULSE_MS = 2;

    // Sets the dead band to start from; a repeated value keeps what was learned since.
    void start_from(uint16_t dead_band_permille) {
        if (dead_band_permille == given_dead_band_) return;
        given_dead_band_ = dead_band_ = dead_band_permille;
        set_slope();
    }
    uint16_t dead_band() const { return dead_band_; }
    float full_mm_s() const { return full_mm_s_; }

    // Wanted speed in mm/s, positive presses.
    void want(float mm_s);
    // Full duty upwards, or the duty of a few mm/s.
    void lift(bool gently);
    void rest() { want(0); }

    // Once a millisecond: the duty in permille for the next one.
    int16_t tick();
    // Once a millisecond, where a potentiometer is fitted.
    void watch(uint16_t position_um);

  private:
    void set_slope() {
        slope_ = (FULL - dead_band_) / full_mm_s_;
        gentle_ = duty(GENTLE_MM_S);
    }
    int16_t duty(float mm_s) const;
    void learn(uint16_t travel_um, uint16_t ms);

    static constexpr int16_t WHOLE_PULSE = 8192;
    static constexpr float GENTLE_MM_S = board::GENTLE_LIFT_MM_S;

    float full_mm_s_ = board::ACTUATOR_MAX_MM_S;  // speed at full duty
    float slope_ = 900.0f / board::ACTUATOR_MAX_MM_S;  // permille for each mm/s above the dead band
    int16_t wanted_ = 0;       // share of a pulse each slot, in parts of WHOLE_PULSE
    int16_t owed_ = 0;         // the same, not yet given
    int16_t direct_ = 0;       // duty of a speed above PULSE_MM_S, or of a pulse that presses
    int16_t pulse_ = 0;
    uint8_t pulse_left_ = 0;
    bool pulsing_ = true, full_known_ = false;
    uint16_t dead_band_ = 100, given_dead_band_ = 100;
    int16_t gentle_ = 100 + 900 * GENTLE_MM_S / board::ACTUATOR_MAX_MM_S;  // duty of a gentle lift
    int16_t watched_ = 0;      // duty under observation
    uint16_t watched_ms_ = 0;
    uint16_t started_um_ = 0;
};

#endif  // ACTUATOR_H
