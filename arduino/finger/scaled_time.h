// Scaled time (Iskarous et al., equation 2, in steps): the integral of velocity over v_ref.
//
// All in integers: 1 µm/s for 1 ms is 1 nm, and a window of 100 ms of scaled time is as many
// nanometres as 100 ms at the reference speed, so nothing is rounded.
#ifndef FINGER_SCALED_TIME_H
#define FINGER_SCALED_TIME_H

#include <stdint.h>

const uint32_t WINDOW_MS = 100;
const uint32_t DEFAULT_REFERENCE_UM_PER_S = 100000;

class ScaledTime {
public:
    // Starts a scan with a reference speed above 0.
    void start(uint32_t reference_um_per_s);

    // Returns the window in which the next sample begins, and moves on by its millisecond.
    // A window is never skipped as long as the velocity is at most fastest_um_per_s().
    uint32_t advance(uint32_t velocity_um_per_s);

    uint64_t distance_nm() const { return distance_nm_; }
    uint32_t window_nm() const { return window_nm_; }

private:
    uint64_t distance_nm_ = 0;
    uint32_t window_nm_ = DEFAULT_REFERENCE_UM_PER_S * WINDOW_MS;
};

// Above this velocity a window would be shorter than a sample.
inline uint32_t fastest_um_per_s(uint32_t reference_um_per_s) { return reference_um_per_s * WINDOW_MS; }

#endif
