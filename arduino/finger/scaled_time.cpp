#include "scaled_time.h"

void ScaledTime::start(uint32_t reference_um_per_s)
{
    distance_nm_ = 0;
    window_nm_ = fastest_um_per_s(reference_um_per_s);
}

uint32_t ScaledTime::advance(uint32_t velocity_um_per_s)
{
    const uint32_t window = uint32_t(distance_nm_ / window_nm_);
    distance_nm_ += velocity_um_per_s;
    return window;
}
