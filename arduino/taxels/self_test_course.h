// The sequence of the self-test: one step a frame in the spare slots, while sampling continues.
#ifndef SELF_TEST_COURSE_H
#define SELF_TEST_COURSE_H

#include "self_test.h"  // readings, result
#include "wire.h"       // frames

class SelfTestCourse {
public:
    // Restarts, also during a self-test.
    void begin();
    bool running() const { return step_ != NOT_RUNNING; }

    // Once a frame: takes what the last step brought, asks for the next. True when the test ended.
    bool next(const Frame &frame);

    // The last test that ended; its count is 0 before the first.
    const SelfTest &result() const { return result_; }

    // 0: not measured. Between tests the spare slots read the bandgap.
    uint16_t supply_mv() const;

private:
    static constexpr uint8_t NOT_RUNNING = 0xff;

    void ask() const;
    bool answered();
    void add_driven(const Frame &frame);
    void end();

    SelfTest result_ = SelfTest();
    TestReadings read_ = TestReadings();
    uint8_t step_ = NOT_RUNNING;
    uint8_t frames_ = 0;
    uint16_t bandgap_ = 0;
};

#endif  // SELF_TEST_COURSE_H
