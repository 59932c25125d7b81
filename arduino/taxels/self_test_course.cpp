#include "self_test_course.h"

#include "ports.h"

namespace {

constexpr uint8_t DRIVEN_FRAMES = 16;
constexpr uint8_t REST_STEP = LINES, ALONE_STEP = REST_STEP + INPUTS, ALL_STEP = ALONE_STEP + INPUTS;
constexpr uint8_t STEPS = ALL_STEP + INPUTS;
constexpr uint8_t ALL_INPUTS = (1 << INPUTS) - 1;

uint16_t from_the_divider(uint16_t reading) {
    return DRIVE_HIGH ? reading : 1023 - reading;
}

}  // namespace

void SelfTestCourse::ask() const {
    if (step_ < REST_STEP) ask_line(step_);
    else if (step_ < ALONE_STEP) ask_input(step_ - REST_STEP, 0);
    else if (step_ < ALL_STEP) ask_input(step_ - ALONE_STEP, uint8_t(1 << (step_ - ALONE_STEP)));
    else ask_input(step_ - ALL_STEP, ALL_INPUTS);
}

bool SelfTestCourse::answered() {
    if (step_ < REST_STEP) return line_answered();
    uint16_t reading;
    if (!spare_answered(reading)) return false;
    reading = from_the_divider(reading);
    if (step_ < ALONE_STEP) read_.rest[step_ - REST_STEP] = reading;
    else if (step_ < ALL_STEP) read_.alone[step_ - ALONE_STEP] = reading;
    else read_.all[step_ - ALL_STEP] = reading;
    return true;
}

void SelfTestCourse::add_driven(const Frame &frame) {
    if (frames_ == DRIVEN_FRAMES) return;
    for (uint8_t i = 0; i < TAXELS; i++) read_.driven[i] += from_the_divider(frame.reading[i]);
    frames_++;
}

void SelfTestCourse::end() {
    const LineTest lines = take_line_tests();
    read_.lines_low = lines.low;
    read_.lines_high = lines.high;
    read_.lines_together = lines.together;
    for (uint8_t i = 0; i < TAXELS; i++) read_.driven[i] /= DRIVEN_FRAMES;
    uint8_t count = uint8_t(result_.count + 1);
    result_ = judge(read_);
    result_.count = count ? count : 1;
    step_ = NOT_RUNNING;
    ask_bandgap();
}

void SelfTestCourse::begin() {
    read_ = TestReadings();
    frames_ = 0;
    step_ = 0;
    take_line_tests();
    ask();
}

bool SelfTestCourse::next(const Frame &frame) {
    if (!running()) {
        uint16_t reading;
        if (spare_answered(reading)) bandgap_ = reading;
        return false;
    }
    add_driven(frame);
    if (!answered()) return false;
    if (++step_ == STEPS) {
        end();
        return true;
    }
    ask();
    return false;
}

uint16_t SelfTestCourse::supply_mv() const {
    return bandgap_ ? uint16_t(uint32_t(BANDGAP_MV) * 1024 / bandgap_) : 0;
}
