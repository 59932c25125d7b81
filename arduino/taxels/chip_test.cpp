#include "chip_test.h"

#include "chip_sampling.h"

namespace {

const uint8_t DRIVEN_FRAMES = 16;
const uint8_t REST_STEP = LINES, ALONE_STEP = REST_STEP + INPUTS, ALL_STEP = ALONE_STEP + INPUTS;
const uint8_t STEPS = ALL_STEP + INPUTS;
const uint8_t ALL_INPUTS = (1 << INPUTS) - 1;
const uint8_t NOT_RUNNING = 0xFF;

SelfTest result;
TestReadings read;
uint8_t step = NOT_RUNNING;
uint8_t frames;
uint16_t bandgap;

uint16_t from_the_divider(uint16_t reading)
{
    return DRIVE_HIGH ? reading : 1023 - reading;
}

void ask()
{
    if (step < REST_STEP) ask_line(step);
    else if (step < ALONE_STEP) ask_input(step - REST_STEP, 0);
    else if (step < ALL_STEP) ask_input(step - ALONE_STEP, uint8_t(1 << (step - ALONE_STEP)));
    else ask_input(step - ALL_STEP, ALL_INPUTS);
}

bool answered()
{
    if (step < REST_STEP) return line_answered();
    uint16_t reading;
    if (!spare_answered(reading)) return false;
    reading = from_the_divider(reading);
    if (step < ALONE_STEP) read.rest[step - REST_STEP] = reading;
    else if (step < ALL_STEP) read.alone[step - ALONE_STEP] = reading;
    else read.all[step - ALL_STEP] = reading;
    return true;
}

void add_driven(const Frame &frame)
{
    if (frames == DRIVEN_FRAMES) return;
    for (uint8_t i = 0; i < TAXELS; i++) read.driven[i] += from_the_divider(frame.reading[i]);
    frames++;
}

void end()
{
    const LineTest lines = take_line_tests();
    read.lines_low = lines.low;
    read.lines_high = lines.high;
    read.lines_together = lines.together;
    for (uint8_t i = 0; i < TAXELS; i++) read.driven[i] /= DRIVEN_FRAMES;
    uint8_t count = uint8_t(result.count + 1);
    result = judge(read);
    result.count = count ? count : 1;
    step = NOT_RUNNING;
    ask_bandgap();
}

}  // namespace

void begin_self_test()
{
    read = TestReadings();
    frames = 0;
    step = 0;
    take_line_tests();
    ask();
}

bool self_test_running()
{
    return step != NOT_RUNNING;
}

bool continue_self_test(const Frame &frame)
{
    if (!self_test_running()) {
        uint16_t reading;
        if (spare_answered(reading)) bandgap = reading;
        return false;
    }
    add_driven(frame);
    if (!answered()) return false;
    if (++step == STEPS) {
        end();
        return true;
    }
    ask();
    return false;
}

const SelfTest &last_self_test()
{
    return result;
}

uint16_t supply_mv()
{
    return bandgap ? uint16_t(uint32_t(BANDGAP_MV) * 1024 / bandgap) : 0;
}
