// What follows from how often the load cell is read. The settings choose one of two rates.
#ifndef SAMPLING_H
#define SAMPLING_H

#include <stdint.h>

struct Sampling {
    bool slow;
    uint32_t period_us;
    uint32_t gap_us;       // between two samples: one is missing
    uint32_t silence_us;   // without a sample: a fault
    uint16_t low_rate, high_rate;  // 0.01 samples a second: beyond them it is another rate
    float period_s, delay_s;
    float late;            // delay over period
    float decay;           // of the actuator's speed in a period
    float coast_s;         // of travel, what a speed that decays adds in a period
    float seen_s;          // of the drum's angle: what a sample shows is this old, negative
    float free_step_mm_s;  // a speed without contact changes no faster, a period
    float run_out_gain;    // of each surprise
    float run_out_kept;    // from one sample to the next
    uint16_t overrun_um;   // travel beyond a force that is too much
    uint16_t late_um;      // travel in contact before a sample shows it
    uint8_t part_samples;  // an eighth of the time in which a force must be steady
    uint16_t settle_ms;    // shortest time that shows a settled force: ten samples
};

namespace sampling {

extern const Sampling FAST, SLOW;

inline const Sampling &of(bool slow) { return slow ? SLOW : FAST; }

}  // namespace sampling

#endif  // SAMPLING_H
