// Input wires by the majority of three looks, where one look shows a change.
#ifndef STEADY_LEVEL_H
#define STEADY_LEVEL_H

#include <avr/io.h>

// Bits of a port where two of three looks, 1.5 µs apart, agree; one look suffices where it shows
// `expected`. A spike that passes the resistor and capacitor of a wire (arduino/README.md) and is
// shorter than that meets one look at most.
__attribute__((always_inline)) inline uint8_t steady_level(const volatile uint8_t &port, uint8_t bits,
                                                           uint8_t expected) {
    constexpr uint8_t APART_CYCLES = 22;
    const uint8_t first = port & bits;
    if (first == expected) return first;
    __builtin_avr_delay_cycles(APART_CYCLES);
    const uint8_t second = port & bits;
    __builtin_avr_delay_cycles(APART_CYCLES);
    const uint8_t third = port & bits;
    return (first & second) | (second & third) | (first & third);
}

#endif  // STEADY_LEVEL_H
