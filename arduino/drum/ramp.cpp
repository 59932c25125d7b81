#include "ramp.h"

#include "board.h"       // clock and step size
#include "ramp_table.h"  // square roots

namespace {

constexpr uint8_t FRACTION_BITS = 8;
constexpr uint16_t TABLE_START = 64;
constexpr uint16_t TABLE_END = 256;

uint32_t square_root(uint64_t value) {
    uint32_t root = 0;
    for (uint32_t bit = 1UL << 31; bit; bit >>= 1) {
        const uint32_t candidate = root | bit;
        if (static_cast<uint64_t>(candidate) * candidate <= value) root = candidate;
    }
    return root;
}

// Both factors are cut to 16 bits first, so that the compiler takes its short product.
inline uint32_t product(uint16_t a, uint16_t b) { return static_cast<uint32_t>(a) * b; }

// value * factor / 2^16 in two short products: it stands in an interrupt.
inline uint32_t scaled(uint32_t value, uint16_t factor) {
    return product(value >> 16, factor) + (product(value, factor) >> 16);
}

}  // namespace

namespace ramp {

Profile profile(uint16_t speed, uint16_t acceleration, int16_t trim_ppm) {
    // cycles a step = clock · step length / speed; both sides kept in integers below 2^64.
    constexpr uint64_t STEP_CYCLES = (static_cast<uint64_t>(board::CLOCK_HZ) << FRACTION_BITS) *
                                     board::NM_PER_STEP / 10000;
    constexpr uint64_t FIRST_SQUARED = static_cast<uint64_t>(board::CLOCK_HZ) *
                                       (board::CLOCK_HZ / 1000000) * board::NM_PER_STEP *
                                       (2ULL << (2 * FRACTION_BITS));
    Profile result;
    const uint64_t divisor = static_cast<uint64_t>(speed) * 1000000;
    result.cruise = (STEP_CYCLES * (1000000 + trim_ppm) + divisor / 2) / divisor;
    result.first = square_root(FIRST_SQUARED / acceleration);
    return result;
}

uint32_t interval(uint32_t first, uint16_t index) {
    if (index < TABLE_START) return scaled(first, flash::word_at(&ROOT_DIFFERENCES[index]));
    uint8_t shift = 0;
    while (index >= TABLE_END) {
        index >>= 2;
        ++shift;
    }
    uint32_t result = scaled(first, flash::word_at(&INVERSE_ROOTS[index - TABLE_START]));
    while (shift--) result >>= 1;
    return result;
}

uint32_t steps_to_speed(uint16_t speed, uint16_t acceleration) {
    // v² / 2a in steps, rounded up, and one more for the step that reaches it.
    const uint64_t square = static_cast<uint64_t>(speed) * speed * 100;  // µm²/s²
    const uint64_t divisor = 2ULL * acceleration * board::NM_PER_STEP;   // µm/s² · nm
    return static_cast<uint32_t>(square / divisor) + 2;
}

uint16_t speed_of(uint32_t interval) {
    if (!interval) return 0;
    constexpr float CYCLES_TIMES_SPEED =
        static_cast<float>(board::CLOCK_HZ) * 256.0f * (board::NM_PER_STEP / 10000.0f);
    return static_cast<uint16_t>(CYCLES_TIMES_SPEED / static_cast<float>(interval) + 0.5f);
}

}  // namespace ramp
