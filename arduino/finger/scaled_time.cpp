#include "scaled_time.h"

void ScaledTime::start(uint32_t reference_um_per_s)
{
    distance_nm_ = 0;
    window_nm_ = fastest_um_per_s(reference_um_per_s);
}

uint32_t ScaledTime::advance(uint32_t velocity_um_per_s)
{
    const uint32_t window = uint32_t(distance_nm_ / window_nm_);
#ifdef DISTANCE_IN_FLOAT  // broken on purpose: a test must see other windows
    distance_nm_ = uint64_t(float(distance_nm_) + float(velocity_um_per_s));
#else
    distance_nm_ += velocity_um_per_s;
#endif
    return window;
}
