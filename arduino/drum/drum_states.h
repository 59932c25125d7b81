// Generated from rigctl/boards/drum_states.py by `python -m rigctl.boards.codegen`;
// change the table there, never this file.
#ifndef DRUM_STATES_H
#define DRUM_STATES_H

#include <stdint.h>

#include "flash.h"  // constant tables stay in program memory

enum class State : uint8_t {
    Boot = 0,
    Selftest = 1,
    Idle = 2,
    Armed = 3,
    Position = 4,
    Approach = 5,
    Hold = 6,
    Run = 7,
    Retract = 8,
    FaultLift = 9,
    FaultOff = 10,
    Nudge = 11,
};

enum class Event : uint8_t {
    Booted = 0,
    SelftestPassed = 1,
    SelftestFailed = 2,
    Arm = 3,
    Disarm = 4,
    Move = 5,
    Approach = 6,
    Run = 7,
    Retract = 8,
    Stop = 9,
    Clear = 10,
    MoveDone = 11,
    ForceSettled = 12,
    TravelDone = 13,
    Lifted = 14,
    TimedFault = 15,
    OffFault = 16,
    LiftTimeOver = 17,
    Nudge = 18,
    Nudged = 19,
};

enum class Fault : uint8_t {
    None = 0,
    Estop = 1,
    OverForce = 2,
    LoadcellSilent = 3,
    LoadcellSaturated = 4,
    LoadcellFrozen = 5,
    LoadcellDesync = 6,
    Heartbeat = 7,
    NoContact = 8,
    ActuatorEnd = 9,
    StepCount = 10,
    Hang = 11,
    Selftest = 12,
    ForceUnreached = 13,
    ActuatorReversed = 14,
    ActuatorStuck = 15,
    PositionWire = 16,
    ForceMissing = 17,
    ForceUnexplained = 18,
    TooDeep = 19,
    ForceUnsteady = 20,
    LoadcellRate = 21,
    LoadcellNoise = 22,
};

constexpr uint8_t STATE_COUNT = 12;
constexpr uint8_t EVENT_COUNT = 20;
constexpr uint8_t FAULT_COUNT = 23;

// Bit n: fault n lifts off before it switches off; all others switch off.
constexpr uint32_t LIFT_FAULTS = 0x7f25fc;

// TRANSITIONS[state][event] is the next state, REFUSED where the event is refused.
constexpr uint8_t REFUSED = 255;
constexpr uint8_t TRANSITIONS[STATE_COUNT][EVENT_COUNT] FLASH = {
    {1, 255, 255, 255, 255, 255, 255, 255, 255, 255, 255, 255, 255, 255, 255, 10, 10, 255, 255, 255},  // BOOT
    {255, 2, 10, 255, 255, 255, 255, 255, 255, 255, 255, 255, 255, 255, 255, 10, 10, 255, 255, 255},  // SELFTEST
    {255, 255, 255, 8, 2, 255, 255, 255, 255, 2, 255, 255, 255, 255, 255, 10, 10, 255, 11, 255},  // IDLE
    {255, 255, 255, 255, 2, 4, 5, 255, 8, 3, 255, 255, 255, 255, 255, 9, 10, 255, 255, 255},  // ARMED
    {255, 255, 255, 255, 255, 255, 255, 255, 255, 8, 255, 3, 255, 255, 255, 9, 10, 255, 255, 255},  // POSITION
    {255, 255, 255, 255, 255, 255, 255, 255, 8, 8, 255, 255, 6, 255, 255, 9, 10, 255, 255, 255},  // APPROACH
    {255, 255, 255, 255, 255, 255, 255, 7, 8, 8, 255, 255, 255, 255, 255, 9, 10, 255, 255, 255},  // HOLD
    {255, 255, 255, 255, 255, 255, 255, 255, 8, 8, 255, 255, 255, 6, 255, 9, 10, 255, 255, 255},  // RUN
    {255, 255, 255, 255, 255, 255, 255, 255, 255, 8, 255, 255, 255, 255, 3, 9, 10, 255, 255, 255},  // RETRACT
    {255, 255, 255, 255, 255, 255, 255, 255, 255, 9, 255, 255, 255, 255, 255, 9, 10, 10, 255, 255},  // FAULT_LIFT
    {255, 255, 255, 255, 255, 255, 255, 255, 255, 10, 2, 255, 255, 255, 255, 10, 10, 255, 255, 255},  // FAULT_OFF
    {255, 255, 255, 255, 2, 255, 255, 255, 255, 2, 255, 255, 255, 255, 255, 10, 10, 255, 255, 2},  // NUDGE
};

enum class Drive : uint8_t {
    Off = 0,
    Hold = 1,
    Approach = 2,
    ForceLoop = 3,
    Lift = 4,
    Nudge = 5,
};

// What the drivers may do in a state; everything not allowed here is held off.
struct Outputs {
    uint8_t stepper_enabled, stepper_may_step, drive;
};

constexpr Outputs OUTPUTS[STATE_COUNT] FLASH = {
    {0, 0, 0},  // BOOT
    {0, 0, 0},  // SELFTEST
    {0, 0, 0},  // IDLE
    {1, 0, 1},  // ARMED
    {1, 1, 1},  // POSITION
    {1, 0, 2},  // APPROACH
    {1, 0, 3},  // HOLD
    {1, 1, 3},  // RUN
    {1, 1, 4},  // RETRACT
    {1, 1, 4},  // FAULT_LIFT
    {0, 0, 0},  // FAULT_OFF
    {0, 0, 5},  // NUDGE
};

#endif  // DRUM_STATES_H
