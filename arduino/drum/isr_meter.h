// Measures every interrupt handler, as its first statement: the longest, and the sum since the last
// query.
//
// Timer 1 runs freely at the chip's clock. The time before and after the measured part (entry,
// saved and restored registers, reti) is added as a constant: its mean to the sum, its maximum to the
// longest.
//
// The budget of every handler of both boards is 400 cycles, 25 µs: an index mark, a step and the stop
// in a row still act within 100 µs. `make bench` measures the longest, their load, and the time that
// the main program keeps interrupts off (firmware.drum.* and firmware.taxels.*: longest_isr_us,
// isr_load, interrupts_off_us). The figures at the handlers are the longest of each, entry included,
// as `python -m tests.firmware.interrupts` prints them for the simulated chips.
#ifndef ISR_METER_H
#define ISR_METER_H

#include <avr/io.h>

struct IsrMeter {
    static constexpr uint16_t AROUND_CYCLES = 100;
    static constexpr uint16_t MOST_AROUND_CYCLES = 160;

    __attribute__((always_inline)) IsrMeter() : start(TCNT1) {}
    __attribute__((always_inline)) ~IsrMeter() {
        const uint16_t cycles = TCNT1 - start;
        if (cycles > longest) longest = cycles;
        sum += cycles + AROUND_CYCLES;
    }

    static volatile uint16_t longest;
    static volatile uint16_t sum;
    const uint16_t start;
};

#endif  // ISR_METER_H
