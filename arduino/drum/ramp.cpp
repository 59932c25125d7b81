#include "ramp.h"

#include <math.h>

#include "ramp_table.h"  // square roots
#include "variant.h"     // clock and step size

// interval() runs inside the step interrupt, also where the IDE builds for size.
#ifdef __AVR__
#pragma GCC optimize("O2")
#endif

namespace {

constexpr uint8_t FRACTION_BITS = 8;
constexpr uint16_t TABLE_END = 256;

// value * factor / 2^16, rounded down. In the step interrupt the compiler's product of 32 and 16
// bits would take 150 cycles; this one takes 48. It adds columns of bytes and omits the lowest from
// the result.
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

// A command computes this while a load-cell sample may be waiting: 64-bit divisions and roots would
// take most of a millisecond.
Profile profile(uint16_t speed, uint16_t acceleration, int16_t trim_ppm) {
    // cycles a step = clock · step length / speed, in so many parts that one fits 32 bits.
    constexpr uint64_t STEP_CYCLES = (static_cast<uint64_t>(board::CLOCK_HZ) << FRACTION_BITS) *
                                     board::NM_PER_STEP / 10000;
    constexpr uint32_t PARTS = STEP_CYCLES / 4 <= 0xffffffffULL ? 4 : 16;
    static_assert(STEP_CYCLES % PARTS == 0 && STEP_CYCLES / PARTS <= 0xffffffffULL,
                  "choose another split");
    // First interval at 1 mm/s²: clock · sqrt(2 · step length).
    static const float FIRST = (1UL << FRACTION_BITS) * static_cast<float>(board::CLOCK_HZ) *
                            __builtin_sqrtf(2e-6f * board::NM_PER_STEP);
    constexpr uint32_t PART = STEP_CYCLES / PARTS;
    Profile result;
    const uint32_t whole = PART / speed;
    const uint16_t left = static_cast<uint16_t>(PART % speed);
    result.cruise = PARTS * whole + (PARTS * left + speed / 2) / speed;
    if (trim_ppm) result.cruise += lroundf(result.cruise * (trim_ppm * 1e-6f));
    result.first = lroundf(FIRST / sqrtf(acceleration));
    return result;
}

uint32_t interval(uint32_t first, uint16_t index) {
    uint8_t halvings = 0;
    if (index >= 4 * TABLE_END) {  // two iterations in one
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
    constexpr uint16_t PART = board::NM_PER_STEP / 25;  // µm²/s² over µm/s² · nm, shortened
    static_assert(board::NM_PER_STEP % 25 == 0, "reduce the fraction again");
    return 2UL * speed * speed / (static_cast<uint32_t>(acceleration) * PART) + 2;
}

uint16_t speed_of(uint32_t interval) {
    if (!interval) return 0;
    constexpr float CYCLES_TIMES_SPEED =
        static_cast<float>(board::CLOCK_HZ) * 256.0f * (board::NM_PER_STEP / 10000.0f);
    return static_cast<uint16_t>(CYCLES_TIMES_SPEED / static_cast<float>(interval) + 0.5f);
}

}  // namespace ramp
