// Input wires that change only when three looks in a row say so.
#ifndef STEADY_LEVEL_H
#define STEADY_LEVEL_H

#include <avr/io.h>

// Bits of a port; one differs from `expected` only if all of three looks do, which are more than
// 10 µs apart from the first to the last: a shorter spike meets two of them at most. What the looks
// disagree on is looked at again, after an edge by the interrupt of the next edge.
__attribute__((always_inline)) inline uint8_t steady_level(const volatile uint8_t &port, uint8_t bits,
                                                           uint8_t expected) {
    constexpr uint8_t APART_CYCLES = 82;
    const uint8_t first = (port & bits) ^ expected;
    if (!first) return expected;
    __builtin_avr_delay_cycles(APART_CYCLES);
    const uint8_t second = port ^ expected;
    __builtin_avr_delay_cycles(APART_CYCLES);
    const uint8_t third = port ^ expected;
    return expected ^ (first & second & third);
}

#endif  // STEADY_LEVEL_H
