// Generated from rigctl/boards/drum_registers.py by `python -m rigctl.boards.codegen`;
// change the table there, never this file.
#ifndef DRUM_MAP_H
#define DRUM_MAP_H

#include <stdint.h>

#include "flash.h"  // constant tables stay in program memory

constexpr uint16_t MAGIC = 21063;
constexpr uint16_t MAP_VERSION = 5;
constexpr uint16_t BOARD_DRUM = 1;
constexpr uint8_t UNIT = 1;
constexpr uint32_t BAUD = 115200;
constexpr uint8_t LOADCELL_RECENT = 5;
constexpr uint8_t RING_DEPTH = 64;
constexpr uint8_t TARE_PLACES = 16;
constexpr int32_t SCALE_LEAST_UG = 200;
constexpr int32_t SCALE_MOST_UG = 25000;
constexpr uint16_t SETTINGS_START = 64;
constexpr uint16_t SETTINGS_WORDS = 51;
constexpr uint16_t COUNTERS_END = 141;
constexpr uint16_t MAP_END = 416;

enum class Command : uint8_t {
    None = 0,
    Arm = 1,
    Disarm = 2,
    Move = 3,
    Approach = 4,
    Run = 5,
    Retract = 6,
    Stop = 7,
    Clear = 8,
    Tare = 9,
    ZeroSteps = 10,
    Home = 11,
    Save = 12,
    Defaults = 13,
    Tune = 14,
    TareTurn = 15,
    TareAnyway = 16,
    Nudge = 17,
    Commission = 18,
    ApproachSetup = 19,
};

enum class CommandResult : uint8_t {
    None = 0,
    Done = 1,
    Running = 2,
    WrongState = 3,
    Failed = 4,
};

enum class ForceMode : uint8_t {
    Hold = 0,
    Lock = 1,
    Position = 2,
};

enum class Signal : uint8_t {
    Estop = 0,
    Index = 1,
    EndSwitches = 2,
    Position = 3,
    Sync = 4,
};

enum class SettingsFrom : uint8_t {
    Defaults = 0,
    Saved = 1,
    Damaged = 2,
};

enum class Status : uint8_t {
    SyncHigh = 0,
    IndexHigh = 1,
    ForceSettled = 2,
    InContact = 3,
    SpeedConstant = 4,
    EstopClosed = 5,
    EndUp = 6,
    EndDown = 7,
    Homed = 8,
    Tared = 9,
    ContactMayStand = 10,
    LiftFailed = 11,
    Commissioned = 12,
    DirectionKnown = 13,
    CellTrusted = 14,
};

enum class Guard : uint8_t {
    None = 0,
    Resting = 1,
    Lifted = 2,
};

enum class ResetCause : uint8_t {
    PowerOn = 0,
    External = 1,
    BrownOut = 2,
    Watchdog = 3,
    Jtag = 4,
};

enum class Kind : uint8_t { U16, I16, U32, I32 };

namespace reg {
constexpr uint16_t magic = 0;
constexpr uint16_t map_version = 1;
constexpr uint16_t board_id = 2;
constexpr uint16_t firmware_version = 3;
constexpr uint16_t build_hash = 4;
constexpr uint16_t boot_count = 6;
constexpr uint16_t reset_cause = 7;
constexpr uint16_t ring_depth = 8;
constexpr uint16_t steps_per_turn = 9;
constexpr uint16_t nm_per_step = 10;
constexpr uint16_t most_force = 12;
constexpr uint16_t overrun_um = 13;
constexpr uint16_t state = 16;
constexpr uint16_t fault = 17;
constexpr uint16_t fault_at_ms = 18;
constexpr uint16_t fault_bits = 20;
constexpr uint16_t board_time_us = 22;
constexpr uint16_t steps = 24;
constexpr uint16_t angle = 26;
constexpr uint16_t speed = 27;
constexpr uint16_t force = 28;
constexpr uint16_t actuator_position_um = 29;
constexpr uint16_t actuator_drive = 30;
constexpr uint16_t command_acknowledged = 31;
constexpr uint16_t command_result = 32;
constexpr uint16_t sync_count = 33;
constexpr uint16_t sync_rise_us = 34;
constexpr uint16_t sync_fall_us = 36;
constexpr uint16_t index_count = 38;
constexpr uint16_t loadcell_sequence = 39;
constexpr uint16_t loadcell_time_us = 40;
constexpr uint16_t loadcell_recent = 42;
constexpr uint16_t heartbeat_seen = 52;
constexpr uint16_t crc_errors = 53;
constexpr uint16_t status_bits = 54;
constexpr uint16_t last_contact_um = 55;
constexpr uint16_t heartbeat = 64;
constexpr uint16_t command = 65;
constexpr uint16_t command_sequence = 66;
constexpr uint16_t signal_polarity = 67;
constexpr uint16_t speed_set = 68;
constexpr uint16_t force_set = 69;
constexpr uint16_t acceleration_set = 70;
constexpr uint16_t direction_set = 71;
constexpr uint16_t force_mode = 72;
constexpr uint16_t travel_set = 73;
constexpr uint16_t run_in_set = 74;
constexpr uint16_t depth_set_um = 75;
constexpr uint16_t move_target = 76;
constexpr uint16_t move_speed_set = 78;
constexpr uint16_t clock_trim_ppm = 79;
constexpr uint16_t settle_band = 80;
constexpr uint16_t settle_time_ms = 81;
constexpr uint16_t approach_limit_um = 82;
constexpr uint16_t approach_timeout_ms = 83;
constexpr uint16_t over_force = 84;
constexpr uint16_t lift_clearance_um = 85;
constexpr uint16_t tare_counts = 86;
constexpr uint16_t scale_ug_per_count = 88;
constexpr uint16_t gain_p = 90;
constexpr uint16_t gain_i = 91;
constexpr uint16_t stiffness_g_per_mm = 92;
constexpr uint16_t dead_band_permille = 93;
constexpr uint16_t heartbeat_limit_ms = 94;
constexpr uint16_t optional_signals = 95;
constexpr uint16_t run_settle_ms = 96;
constexpr uint16_t tare_place_00 = 97;
constexpr uint16_t tare_place_01 = 98;
constexpr uint16_t tare_place_02 = 99;
constexpr uint16_t tare_place_03 = 100;
constexpr uint16_t tare_place_04 = 101;
constexpr uint16_t tare_place_05 = 102;
constexpr uint16_t tare_place_06 = 103;
constexpr uint16_t tare_place_07 = 104;
constexpr uint16_t tare_place_08 = 105;
constexpr uint16_t tare_place_09 = 106;
constexpr uint16_t tare_place_10 = 107;
constexpr uint16_t tare_place_11 = 108;
constexpr uint16_t tare_place_12 = 109;
constexpr uint16_t tare_place_13 = 110;
constexpr uint16_t tare_place_14 = 111;
constexpr uint16_t tare_place_15 = 112;
constexpr uint16_t nudge_direction = 113;
constexpr uint16_t loadcell_slow = 114;
constexpr uint16_t frames_seen = 116;
constexpr uint16_t exceptions_sent = 117;
constexpr uint16_t longest_isr_us = 118;
constexpr uint16_t free_stack_bytes = 119;
constexpr uint16_t idle_permille = 120;
constexpr uint16_t loadcell_dropped = 121;
constexpr uint16_t index_error_steps = 122;
constexpr uint16_t proposed_gain_p = 123;
constexpr uint16_t proposed_gain_i = 124;
constexpr uint16_t tuned_stiffness_g_per_mm = 125;
constexpr uint16_t tuned_delay = 126;
constexpr uint16_t settings_from = 127;
constexpr uint16_t late_ticks = 128;
constexpr uint16_t settings_hash = 129;
constexpr uint16_t loadcell_rate = 131;
constexpr uint16_t loadcell_spikes = 132;
constexpr uint16_t loadcell_noise = 133;
constexpr uint16_t loadcell_unique = 134;
constexpr uint16_t position_raw = 135;
constexpr uint16_t nudge_travel_um = 136;
constexpr uint16_t nudge_duty = 137;
constexpr uint16_t tuned_dead_band = 138;
constexpr uint16_t tuned_stiction = 139;
constexpr uint16_t tuned_rate = 140;
constexpr uint16_t ring_raw = 160;
constexpr uint16_t ring_time_us = 288;
}  // namespace reg

// Everything that may be written, by rising address; bounds are raw register integers,
// `least` bounds the magnitude.
struct Setting {
    uint16_t address;
    Kind kind;
    Guard guard;
    int32_t low, high, initial, least;
};

constexpr uint8_t SETTING_COUNT = 48;
constexpr Setting SETTINGS[SETTING_COUNT] FLASH = {
    {64, Kind::U16, Guard::None, 0L, 65535L, 0L, 0L},  // heartbeat, 
    {65, Kind::U16, Guard::None, 0L, 19L, 0L, 0L},  // command, 
    {66, Kind::U16, Guard::None, 0L, 65535L, 0L, 0L},  // command_sequence, 
    {67, Kind::U16, Guard::Resting, 0L, 31L, 0L, 0L},  // signal_polarity, 
    {68, Kind::U16, Guard::None, 500L, 20000L, 8000L, 0L},  // speed_set, mm/s
    {69, Kind::U16, Guard::None, 500L, 15000L, 5000L, 0L},  // force_set, g
    {70, Kind::U16, Guard::None, 50L, 2000L, 600L, 0L},  // acceleration_set, mm/s²
    {71, Kind::U16, Guard::None, 0L, 1L, 0L, 0L},  // direction_set, 
    {72, Kind::U16, Guard::Resting, 0L, 2L, 0L, 0L},  // force_mode, 
    {73, Kind::U16, Guard::None, 10L, 6000L, 2450L, 0L},  // travel_set, mm
    {74, Kind::U16, Guard::None, 0L, 2000L, 1000L, 0L},  // run_in_set, mm
    {75, Kind::U16, Guard::Resting, 0L, 10000L, 1000L, 0L},  // depth_set_um, µm
    {76, Kind::I32, Guard::None, -2000000L, 2000000L, 0L, 0L},  // move_target, steps
    {78, Kind::U16, Guard::None, 500L, 32000L, 20000L, 0L},  // move_speed_set, mm/s
    {79, Kind::I16, Guard::None, -10000L, 10000L, 0L, 0L},  // clock_trim_ppm, ppm
    {80, Kind::U16, Guard::None, 2L, 200L, 20L, 0L},  // settle_band, permille
    {81, Kind::U16, Guard::None, 50L, 5000L, 300L, 0L},  // settle_time_ms, ms
    {82, Kind::U16, Guard::None, 500L, 50000L, 30000L, 0L},  // approach_limit_um, µm
    {83, Kind::U16, Guard::None, 500L, 30000L, 10000L, 0L},  // approach_timeout_ms, ms
    {84, Kind::U16, Guard::Resting, 1000L, 30000L, 14000L, 0L},  // over_force, g
    {85, Kind::U16, Guard::None, 500L, 20000L, 3000L, 0L},  // lift_clearance_um, µm
    {86, Kind::I32, Guard::Lifted, -8388608L, 8388607L, 0L, 0L},  // tare_counts, counts
    {88, Kind::I32, Guard::Resting, -25000L, 25000L, 2400L, 200L},  // scale_ug_per_count, µg/count
    {90, Kind::U16, Guard::None, 1L, 5000L, 600L, 0L},  // gain_p, 1/s
    {91, Kind::U16, Guard::None, 0L, 5000L, 500L, 0L},  // gain_i, 1/s
    {92, Kind::U16, Guard::None, 50L, 5000L, 900L, 0L},  // stiffness_g_per_mm, g/mm
    {93, Kind::U16, Guard::None, 0L, 500L, 100L, 0L},  // dead_band_permille, permille
    {94, Kind::U16, Guard::None, 100L, 250L, 250L, 0L},  // heartbeat_limit_ms, ms
    {95, Kind::U16, Guard::Resting, 0L, 31L, 31L, 0L},  // optional_signals, 
    {96, Kind::U16, Guard::None, 0L, 2000L, 100L, 0L},  // run_settle_ms, ms
    {97, Kind::I16, Guard::Lifted, -32768L, 32767L, 0L, 0L},  // tare_place_00, counts
    {98, Kind::I16, Guard::Lifted, -32768L, 32767L, 0L, 0L},  // tare_place_01, counts
    {99, Kind::I16, Guard::Lifted, -32768L, 32767L, 0L, 0L},  // tare_place_02, counts
    {100, Kind::I16, Guard::Lifted, -32768L, 32767L, 0L, 0L},  // tare_place_03, counts
    {101, Kind::I16, Guard::Lifted, -32768L, 32767L, 0L, 0L},  // tare_place_04, counts
    {102, Kind::I16, Guard::Lifted, -32768L, 32767L, 0L, 0L},  // tare_place_05, counts
    {103, Kind::I16, Guard::Lifted, -32768L, 32767L, 0L, 0L},  // tare_place_06, counts
    {104, Kind::I16, Guard::Lifted, -32768L, 32767L, 0L, 0L},  // tare_place_07, counts
    {105, Kind::I16, Guard::Lifted, -32768L, 32767L, 0L, 0L},  // tare_place_08, counts
    {106, Kind::I16, Guard::Lifted, -32768L, 32767L, 0L, 0L},  // tare_place_09, counts
    {107, Kind::I16, Guard::Lifted, -32768L, 32767L, 0L, 0L},  // tare_place_10, counts
    {108, Kind::I16, Guard::Lifted, -32768L, 32767L, 0L, 0L},  // tare_place_11, counts
    {109, Kind::I16, Guard::Lifted, -32768L, 32767L, 0L, 0L},  // tare_place_12, counts
    {110, Kind::I16, Guard::Lifted, -32768L, 32767L, 0L, 0L},  // tare_place_13, counts
    {111, Kind::I16, Guard::Lifted, -32768L, 32767L, 0L, 0L},  // tare_place_14, counts
    {112, Kind::I16, Guard::Lifted, -32768L, 32767L, 0L, 0L},  // tare_place_15, counts
    {113, Kind::U16, Guard::None, 0L, 1L, 0L, 0L},  // nudge_direction, 
    {114, Kind::U16, Guard::Resting, 0L, 1L, 0L, 0L},  // loadcell_slow, 
};

#endif  // DRUM_MAP_H
