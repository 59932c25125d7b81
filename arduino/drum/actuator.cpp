#include "actuator.h"

#include "board.h"  // speed at full duty

namespace actuator {

// Speeds below this are asked for by a share of the dead band, so that noise around
// standstill does not throw the bridge from one side to the other.
constexpr float CREEP_MM_S = 0.01f;

int16_t duty(float speed_mm_s, uint16_t dead_band_permille) {
    const bool lifts = speed_mm_s < 0;
    const float size = lifts ? -speed_mm_s : speed_mm_s;
    float permille = (FULL - dead_band_permille) * size / board::ACTUATOR_MAX_MM_S;
    permille += size < CREEP_MM_S ? dead_band_permille * size / CREEP_MM_S : dead_band_permille;
    if (permille > FULL) permille = FULL;
    const int16_t rounded = static_cast<int16_t>(permille + 0.5f);
    return lifts ? -rounded : rounded;
}

}  // namespace actuator
