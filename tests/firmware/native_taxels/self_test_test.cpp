// What the self-test makes of its readings, on the PC.
#include "../native/check.h"
#include "self_test.h"

namespace {

// A board as it should be: dividers of 10 kOhm, pull-ups of 35 kOhm, taxels at rest.
TestReadings healthy() {
    TestReadings read = {};
    for (uint8_t i = 0; i < INPUTS; ++i) {
        read.rest[i] = 1;
        read.alone[i] = read.all[i] = 227;
    }
    for (uint8_t i = 0; i < TAXELS; ++i) read.driven[i] = 20;
    return read;
}

}  // namespace

TEST(a_healthy_board_has_no_findings) {
    const SelfTest test = judge(healthy());
    CHECK(!found_fault(test));
    CHECK_EQUAL(test.tested, TESTED_LINES | TESTED_OPEN | TESTED_SHORTS | TESTED_TAXELS);
}

TEST(any_pull_up_of_the_data_sheet_is_healthy) {
    for (uint32_t ohm = 20000; ohm <= 50000; ohm += 1000) {
        TestReadings read = healthy();
        for (uint8_t i = 0; i < INPUTS; ++i)
            read.alone[i] = read.all[i] = uint16_t(1023UL * DIVIDER_OHM / (DIVIDER_OHM + ohm));
        CHECK(!found_fault(judge(read)));
    }
}

TEST(two_inputs_in_one_node_are_found_with_any_pull_up) {
    for (uint32_t ohm = 20000; ohm <= 50000; ohm += 1000) {
        TestReadings read = healthy();
        const uint32_t half = DIVIDER_OHM / 2;
        for (uint8_t i = 0; i < INPUTS; ++i)
            read.alone[i] = read.all[i] = uint16_t(1023UL * DIVIDER_OHM / (DIVIDER_OHM + ohm));
        for (uint8_t i = 1; i < 3; ++i) read.alone[i] = uint16_t(1023UL * half / (half + ohm));
        CHECK_EQUAL(judge(read).inputs_together, 6);
    }
}

TEST(each_kind_of_input_fault_is_told_apart) {
    TestReadings read = healthy();
    read.rest[0] = read.alone[0] = read.all[0] = 1020;
    read.alone[1] = read.all[1] = 900;
    read.alone[2] = read.all[2] = 2;
    const SelfTest test = judge(read);
    CHECK_EQUAL(test.inputs_high, 1);
    CHECK_EQUAL(test.inputs_open, 2);
    CHECK_EQUAL(test.inputs_low, 4);
    CHECK_EQUAL(test.inputs_together, 0);
}

TEST(a_shorted_taxel_is_not_called_a_grounded_input) {
    TestReadings read = healthy();
    read.driven[2 + INPUTS] = 1022;
    read.alone[2] = read.all[2] = 1;
    const SelfTest test = judge(read);
    CHECK_EQUAL(test.inputs_low, 0);
    CHECK_EQUAL(test.full, 1UL << (2 + INPUTS));
}

TEST(silent_taxels_up_to_the_last_are_told) {
    TestReadings read = healthy();
    read.driven[0] = read.driven[17] = 2;
    CHECK_EQUAL(judge(read).silent, 1UL | 1UL << 17);
}
