#include "ramp.h"

#include "board.h"       // clock and step size
#include "ramp_table.h"  // square roots

// interval() runs inside the step interrupt, also where the IDE builds for size.
#pragma GCC optimize("O2")

namespace {

constexpr uint8_t FRACTION_BITS = 8;
constexpr uint16_t TABLE_END = 256;

uint32_t square_root(uint64_t value) {
    uint32_t root = 0;
    for (uint32_t bit = 1UL << 31; bit; bit >>= 1) {
        const uint32_t candidate = root | bit;
        if (static_cast<uint64_t>(candidate) * candidate <= value) root = candidate;
    }
    return root;
}

// value * factor / 2^16, rounded down. It stands in the step interrupt, where the compiler's
// own product of 32 and 16 bits would take 150 cycles for these 48: column by column of bytes,
// the lowest one left out of the result.
inline uint32_t scaled(uint32_t value, uint16_t factor) {
#ifdef __AVR__
    uint32_t result;
    uint8_t below, zero;
    asm("clr %[zero]\n\t"
        "mul %A[v], %A[f]\n\t"
        "mov %[below], r1\n\t"
        "mul %B[v], %B[f]\n\t"
        "movw %A[r], r0\n\t"
        "mul %D[v], %B[f]\n\t"
        "movw %C[r], r0\n\t"
        "mul %A[v], %B[f]\n\t"
        "add %[below], r0\n\t"
        "adc %A[r], r1\n\t"
        "adc %B[r], %[zero]\n\t"
        "adc %C[r], %[zero]\n\t"
        "adc %D[r], %[zero]\n\t"
        "mul %B[v], %A[f]\n\t"
        "add %[below], r0\n\t"
        "adc %A[r], r1\n\t"
        "adc %B[r], %[zero]\n\t"
        "adc %C[r], %[zero]\n\t"
        "adc %D[r], %[zero]\n\t"
        "mul %C[v], %A[f]\n\t"
        "add %A[r], r0\n\t"
        "adc %B[r], r1\n\t"
        "adc %C[r], %[zero]\n\t"
        "adc %D[r], %[zero]\n\t"
        "mul %C[v], %B[f]\n\t"
        "add %B[r], r0\n\t"
        "adc %C[r], r1\n\t"
        "adc %D[r], %[zero]\n\t"
        "mul %D[v], %A[f]\n\t"
        "add %B[r], r0\n\t"
        "adc %C[r], r1\n\t"
        "adc %D[r], %[zero]\n\t"
        "clr r1"
        : [r] "=&r"(result), [below] "=&r"(below), [zero] "=&r"(zero)
        : [v] "r"(value), [f] "r"(factor));
    return result;
#else
    return static_cast<uint64_t>(value) * factor >> 16;
#endif
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
    uint8_t halvings = 0;
    if (index >= 4 * TABLE_END) {  // two rounds of the loop at once
        index >>= 4;
        halvings = 2;
    }
    for (; index >= TABLE_END; index >>= 2) ++halvings;
    uint32_t result = scaled(first, flash::word_at(&STEP_SHARES[index]));
    for (; halvings; --halvings) result >>= 1;
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
