// The self-test's course: a step a frame in the spare slots, while sampling goes on.
#ifndef TAXELS_CHIP_TEST_H
#define TAXELS_CHIP_TEST_H

#include "self_test.h"
#include "wire.h"

// Begins anew, also while one is under way.
void begin_self_test();
bool self_test_running();

// Once a frame: takes what the last step brought, asks for the next. True when the test ended.
bool continue_self_test(const Frame &frame);

// The last test that ended; its count is 0 before the first.
const SelfTest &last_self_test();

// 0: not measured. Between tests the spare slots read the bandgap.
uint16_t supply_mv();

#endif
