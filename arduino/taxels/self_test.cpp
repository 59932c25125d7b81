#include "self_test.h"

namespace {

constexpr uint16_t FULL = 1023;
constexpr uint16_t NOISE = 16;        // counts, with a wide margin
constexpr uint16_t HIGH_AT_REST = 64;
constexpr uint16_t SILENT_BELOW = 4;  // mean counts of a taxel that does not even conduct at rest
constexpr uint16_t FULL_ABOVE = 1015;
constexpr uint16_t OPEN_AT_MOST = 768;

// The chip's pull-ups, ATmega328P data sheet, DC characteristics.
constexpr uint32_t PULL_LEAST_OHM = 20000, PULL_MOST_OHM = 50000;
constexpr uint16_t PULLED_LEAST = uint16_t(uint32_t(FULL) * DIVIDER_OHM / (DIVIDER_OHM + PULL_MOST_OHM));
constexpr uint16_t PULLED_MOST = uint16_t(uint32_t(FULL) * DIVIDER_OHM / (DIVIDER_OHM + PULL_LEAST_OHM));
constexpr uint16_t OPEN_WANTED = PULLED_MOST + PULLED_MOST / 2 + NOISE;
constexpr uint16_t OPEN_ABOVE = OPEN_WANTED < OPEN_AT_MOST ? OPEN_WANTED : OPEN_AT_MOST;
constexpr uint16_t GROUNDED_BELOW = PULLED_LEAST / 4;

// A pull-up moves an input only away from ground, and a small divider hides what it does.
constexpr bool PULLS_TELL = DRIVE_HIGH;
constexpr bool SHORTS_SHOW = PULLS_TELL && PULLED_LEAST >= 2 * NOISE;

static_assert(DIVIDER_OHM >= 100 && DIVIDER_OHM <= 47000, "the self-test cannot judge this divider");

uint32_t taxels_of(uint8_t input) {
    uint32_t taxels = 0;
    for (uint8_t line = 0; line < LINES; line++) taxels |= 1UL << (line * INPUTS + input);
    return taxels;
}

void judge_input(const TestReadings &read, uint8_t input, SelfTest &test) {
    const uint8_t bit = uint8_t(1 << input);
    if (read.rest[input] > HIGH_AT_REST) {
        test.inputs_high |= bit;
        return;
    }
    if (!PULLS_TELL) return;
    if (read.alone[input] > OPEN_ABOVE) test.inputs_open |= bit;
    if (!SHORTS_SHOW) return;
    if (read.all[input] < GROUNDED_BELOW) {
        // A taxel that is a short leads to a line that is held low.
        if (!(test.full & taxels_of(input))) test.inputs_low |= bit;
        return;
    }
    // Two pull-ups into two dividers are as strong as one into one; one into two is not.
    if (read.alone[input] < read.all[input] - read.all[input] / 5) test.inputs_together |= bit;
}

}  // namespace

SelfTest judge(const TestReadings &read) {
    SelfTest test = SelfTest();
    test.tested = TESTED_LINES | TESTED_TAXELS;
    if (PULLS_TELL) test.tested |= TESTED_OPEN;
    if (SHORTS_SHOW) test.tested |= TESTED_SHORTS;
    test.lines_low = read.lines_low;
    test.lines_high = read.lines_high;
    test.lines_together = read.lines_together;
    for (uint8_t taxel = 0; taxel < TAXELS; taxel++) {
        if (read.driven[taxel] < SILENT_BELOW) test.silent |= 1UL << taxel;
        if (read.driven[taxel] > FULL_ABOVE) test.full |= 1UL << taxel;
    }
    for (uint8_t input = 0; input < INPUTS; input++) judge_input(read, input, test);
    return test;
}

bool found_fault(const SelfTest &test) {
    return test.lines_low | test.lines_high | test.lines_together | test.inputs_high |
           test.inputs_low | test.inputs_open | test.inputs_together || test.silent || test.full;
}
