#include "sampling.h"

#include "variant.h"  // periods, delays, actuator

namespace {

// exp(-x) for x below 4, by a series the compiler works out.
constexpr float series(float x, int terms = 16, float n = 1) {
    return terms ? 1 - x / n * series(x, terms - 1, n + 1) : 1;
}
constexpr float decay(float lags) { return lags < 4 ? series(lags) : 0; }
constexpr float smaller(float a, float b) { return a < b ? a : b; }

// A cell that looks seldom has as many turns to learn them in; more would learn its noise.
constexpr float RUN_OUT_PER_S = 8.0f, MOST_RUN_OUT_GAIN = 0.2f;
// A trial shows most of a turn, not all: what it says is forgotten in seconds, or errors add up
// from trial to trial.
constexpr float FORGOTTEN_IN_S = 6.0f;

constexpr float FREE_MM_S2 = 40.0f;

// The HX711's own oscillator is off by a tenth; its two rates differ by eight.
constexpr uint8_t RATE_PERCENT = 25;
constexpr uint16_t rate_of(uint32_t us, uint32_t percent) { return 1000000UL * percent / us; }

constexpr float FASTEST_MM_S = smaller(board::ACTUATOR_MAX_MM_S, 6.0f);  // in contact
// As long as settling takes three times: 0.66 s at 80 samples a second, 1.77 s at 10.
constexpr float window_s(float period_s) { return 3.03f * (0.5f + 12.7f * period_s); }

// An actuator at full speed goes on until the next sample, as long as that is late, for a tick, and
// for its lag, in which it coasts.
constexpr Sampling every(uint32_t us, float delay_s, bool slow) {
    return {slow,
            us,
            us / 5 * 9,
            us / 5 * 12,
            rate_of(us, 100 - RATE_PERCENT),
            rate_of(us, 100 + RATE_PERCENT),
            us * 1e-6f,
            delay_s,
            delay_s / (us * 1e-6f),
            decay(us * 1e-6f / board::ACTUATOR_LAG_S),
            board::ACTUATOR_LAG_S * (1 - decay(us * 1e-6f / board::ACTUATOR_LAG_S)),
            -delay_s - us * 1e-6f / 2,
            FREE_MM_S2 * (us * 1e-6f),
            smaller(RUN_OUT_PER_S * us * 1e-6f, MOST_RUN_OUT_GAIN),
            1 - us * 1e-6f / FORGOTTEN_IN_S,
            static_cast<uint16_t>(
                board::ACTUATOR_MAX_MM_S *
                    (us * 1e-6f + delay_s + 1e-3f + board::ACTUATOR_LAG_S) * 1000 + 0.5f),
            static_cast<uint16_t>(FASTEST_MM_S * 1000 * (us * 1e-6f + delay_s)),
            static_cast<uint8_t>(window_s(us * 1e-6f) / (us * 1e-6f) / 8),
            static_cast<uint16_t>(us / 100)};
}

}  // namespace

namespace sampling {

const Sampling FAST = every(board::LOADCELL_PERIOD_US, board::LOADCELL_DELAY_S, false);
const Sampling SLOW = every(board::LOADCELL_SLOW_PERIOD_US, board::LOADCELL_SLOW_DELAY_S, true);

}  // namespace sampling
