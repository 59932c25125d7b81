"""The drum's Modbus register table, the only definition of the drum's registers.

``python -m rigctl.wire.codegen`` generates ``arduino/drum/drum_map.h`` and
``docs/reference/drum-wire.md`` from it; a test fails when they are stale. Registers are 16 bits
wide; a 32-bit value takes two, high word first. Addresses count from 0 as on the wire. A value
in engineering units is the register's integer times ``scale``.
"""

from __future__ import annotations

from rigctl.values import SCALE_BAND_UG_PER_COUNT
from rigctl.wire.drum.codes import Guard
from rigctl.wire.drum.register_entry import Register, read_only, setting

MAGIC = 0x5247
MAP_VERSION = 3
BOARD_DRUM = 1
BOARD_TAXELS = 2
UNIT = 1
BAUD = 115200
LOADCELL_RECENT = 5
RING_DEPTH = 64
TARE_PLACES = 16

IDENTITY = (
    read_only(0, "magic", "u16", "", "0x5247, ASCII RG: this is a rigctl board"),
    read_only(1, "map_version", "u16", "", "version of this table; the host refuses another"),
    read_only(2, "board_id", "u16", "", "1: drum"),
    read_only(3, "firmware_version", "u16", "", "major × 256 + minor"),
    read_only(4, "build_hash", "u32", "", "first 32 bits of the hash of the sources built"),
    read_only(6, "boot_count", "u16", "", "boots since the EEPROM was erased, wraps"),
    read_only(7, "reset_cause", "u16", "", "bits of ResetCause, as before the bootloader"),
    read_only(8, "ring_depth", "u16", "", "load-cell samples kept in the ring"),
    read_only(9, "steps_per_turn", "u16", "steps", "microsteps of one drum turn"),
    read_only(
        10, "nm_per_step", "u32", "nm", "texture travel of one microstep at the drum's surface"
    ),
    read_only(12, "most_force", "u16", "g", "force at which the board lifts with any settings"),
    read_only(13, "overrun_um", "u16", "µm", "longest travel from that force until the drum stops"),
)

POLL = (
    read_only(16, "state", "u16", "", "value of State"),
    read_only(17, "fault", "u16", "", "first latched Fault, 0 if none"),
    read_only(18, "fault_at_ms", "u32", "ms", "board time of the first fault"),
    read_only(20, "fault_bits", "u16", "", "causes present now, bit n is fault n"),
    read_only(
        21, "board_time_us", "u32", "µs", "board clock at the reply, wraps after 71.6 minutes"
    ),
    read_only(23, "steps", "i32", "steps", "signed microsteps since ZERO_STEPS or boot"),
    read_only(25, "angle", "u16", "°", "drum angle from the steps", 0.01),
    read_only(26, "speed", "i16", "mm/s", "surface speed commanded to the stepper now", 0.01),
    read_only(27, "force", "i16", "g", "newest load-cell reading after tare and scale", 0.1),
    read_only(28, "actuator_position_um", "u16", "µm", "actuator travel from its upper end"),
    read_only(29, "actuator_drive", "i16", "permille", "signed duty, positive presses"),
    read_only(30, "command_acknowledged", "u16", "", "last command_sequence seen"),
    read_only(31, "command_result", "u16", "", "value of CommandResult for that sequence"),
    read_only(32, "sync_count", "u16", "", "rises of the sync line since boot, wraps"),
    read_only(33, "sync_rise_us", "u32", "µs", "board time of the last rise"),
    read_only(35, "sync_fall_us", "u32", "µs", "board time of the last fall"),
    read_only(37, "index_count", "u16", "", "index marks seen since boot, wraps"),
    read_only(38, "loadcell_sequence", "u16", "", "number of the newest load-cell sample, wraps"),
    read_only(
        39, "loadcell_time_us", "u32", "µs", "board time at which the newest sample was ready"
    ),
    read_only(41, "loadcell_recent", "i32", "counts", "newest raw samples, newest first", count=5),
    read_only(51, "heartbeat_seen", "u16", "", "last heartbeat value received"),
    read_only(52, "crc_errors", "u16", "", "requests dropped for a bad CRC, wraps"),
    read_only(53, "late_ticks", "u16", "", "1 kHz ticks that started a period late or more, wraps"),
    read_only(54, "status_bits", "u16", "", "bits of Status"),
    read_only(55, "last_contact_um", "u16", "µm", "actuator travel at the last contact"),
)

SETTINGS = (
    setting(64, "heartbeat", "u16", "", "any change counts as a beat; 0 is allowed", (0, 65535, 0)),
    setting(
        65, "command", "u16", "", "value of Command, executed with the next register", (0, 16, 0)
    ),
    setting(66, "command_sequence", "u16", "", "a new value executes the command", (0, 65535, 0)),
    setting(
        67,
        "signal_polarity",
        "u16",
        "",
        "bits of Signal: inverted",
        (0, 31, 0),
        guard=Guard.RESTING,
    ),
    setting(68, "speed_set", "u16", "mm/s", "surface speed of RUN", (500, 20000, 8000), 0.01),
    setting(
        69, "force_set", "u16", "g", "force of APPROACH, HOLD and RUN", (500, 15000, 5000), 0.1
    ),
    setting(70, "acceleration_set", "u16", "mm/s²", "acceleration of every ramp", (50, 2000, 600)),
    setting(71, "direction_set", "u16", "", "0 forwards, 1 backwards", (0, 1, 0)),
    setting(72, "force_mode", "u16", "", "value of ForceMode", (0, 2, 0), guard=Guard.RESTING),
    setting(
        73, "travel_set", "u16", "mm", "texture travel while sync is high", (10, 6000, 2450), 0.1
    ),
    setting(
        74, "run_in_set", "u16", "mm", "travel from RUN to the rise of sync", (0, 2000, 1000), 0.1
    ),
    setting(
        75,
        "depth_set_um",
        "u16",
        "µm",
        "actuator depth below contact, force_mode 2",
        (0, 10000, 1000),
        guard=Guard.RESTING,
    ),
    setting(76, "move_target", "i32", "steps", "target of MOVE", (-2000000, 2000000, 0)),
    setting(
        78,
        "move_speed_set",
        "u16",
        "mm/s",
        "surface speed of MOVE, lifted",
        (500, 32000, 20000),
        0.01,
    ),
    setting(
        79,
        "clock_trim_ppm",
        "i16",
        "ppm",
        "error of the board clock, + is fast; the board lowers its rates by it",
        (-10000, 10000, 0),
    ),
    setting(
        80, "settle_band", "u16", "permille", "force band that counts as settled", (2, 200, 20)
    ),
    setting(
        81,
        "settle_time_ms",
        "u16",
        "ms",
        "time inside the band that counts as settled",
        (50, 5000, 300),
    ),
    setting(
        82,
        "approach_limit_um",
        "u16",
        "µm",
        "longest actuator travel without contact; more is a fault",
        (500, 50000, 30000),
    ),
    setting(
        83,
        "approach_timeout_ms",
        "u16",
        "ms",
        "longest time to settle; more is a fault",
        (500, 30000, 10000),
    ),
    setting(
        84,
        "over_force",
        "u16",
        "g",
        "force that lifts immediately; the board's own limit applies as well",
        (1000, 30000, 14000),
        0.1,
        guard=Guard.RESTING,
    ),
    setting(
        85, "lift_clearance_um", "u16", "µm", "lift above the last contact", (500, 20000, 3000)
    ),
    setting(
        86,
        "tare_counts",
        "i32",
        "counts",
        "raw reading at no load",
        (-8388608, 8388607, 0),
        guard=Guard.LIFTED,
    ),
    setting(
        88,
        "scale_ug_per_count",
        "i32",
        "µg/count",
        "load-cell scale, sign included",
        (-SCALE_BAND_UG_PER_COUNT[1], SCALE_BAND_UG_PER_COUNT[1], 2400),
        guard=Guard.RESTING,
        least=SCALE_BAND_UG_PER_COUNT[0],
    ),
    setting(
        90,
        "gain_p",
        "u16",
        "1/s",
        "approach rate per force error over stiffness",
        (1, 5000, 600),
        0.01,
    ),
    setting(
        91,
        "gain_i",
        "u16",
        "1/s",
        "rate learned per unexpected compression, each load-cell sample",
        (0, 5000, 500),
        0.01,
    ),
    setting(
        92,
        "stiffness_g_per_mm",
        "u16",
        "g/mm",
        "contact stiffness: start value, then the estimate",
        (50, 5000, 900),
    ),
    setting(
        93,
        "dead_band_permille",
        "u16",
        "permille",
        "lowest duty that moves the actuator: start value of the board's own estimate",
        (0, 500, 100),
    ),
    setting(
        94, "heartbeat_limit_ms", "u16", "ms", "silence that ramps down and lifts", (100, 250, 250)
    ),
    setting(
        95,
        "optional_signals",
        "u16",
        "",
        "bits of Signal: fitted",
        (0, 31, 31),
        guard=Guard.RESTING,
    ),
    setting(
        96,
        "run_settle_ms",
        "u16",
        "ms",
        "time at constant speed that the run-in must contain after the ramp",
        (0, 2000, 100),
    ),
    *(
        setting(
            97 + place,
            f"tare_place_{place:02d}",
            "i16",
            "counts",
            f"no-load reading minus tare_counts, {place}/{TARE_PLACES} turn after the mark",
            (-32768, 32767, 0),
            guard=Guard.LIFTED,
        )
        for place in range(TARE_PLACES)
    ),
)

COUNTERS = (
    read_only(116, "frames_seen", "u16", "", "requests for this unit with a good CRC, wraps"),
    read_only(117, "exceptions_sent", "u16", "", "requests refused, wraps"),
    read_only(118, "longest_isr_us", "u16", "µs", "longest interrupt since boot"),
    read_only(119, "free_stack_bytes", "u16", "bytes", "stack never used since boot (painted)"),
    read_only(120, "idle_permille", "u16", "permille", "share of the last second spent waiting"),
    read_only(121, "loadcell_dropped", "u16", "", "conversions not used, wraps"),
    read_only(
        122, "index_error_steps", "i16", "steps", "last index mark: steps counted minus expected"
    ),
    read_only(
        123, "proposed_gain_p", "u16", "1/s", "gain_p that the last TUNE proposes, 0: none", 0.01
    ),
    read_only(
        124, "proposed_gain_i", "u16", "1/s", "gain_i that the last TUNE proposes, 0: none", 0.01
    ),
    read_only(
        125, "tuned_stiffness_g_per_mm", "u16", "g/mm", "force per commanded travel, last TUNE"
    ),
    read_only(
        126, "tuned_delay", "u16", "ms", "from a commanded speed to its force, last TUNE", 0.1
    ),
    read_only(127, "settings_from", "u16", "", "value of SettingsFrom: what the board booted with"),
)

RING = (
    read_only(128, "ring_raw", "i32", "counts", "load-cell sample n at n mod 64", count=RING_DEPTH),
    read_only(
        256,
        "ring_time_us",
        "u32",
        "µs",
        "board time of the sample in the same place",
        count=RING_DEPTH,
    ),
)

REGISTERS: tuple[Register, ...] = IDENTITY + POLL + SETTINGS + COUNTERS + RING
BY_NAME: dict[str, Register] = {register.name: register for register in REGISTERS}
IDENTITY_BLOCK = (0, 14)
POLL_BLOCK = (16, 40)
"""First address and count of the read of every poll."""
SETTINGS_BLOCK = (64, 49)
END = 384
"""First address that does not exist; reading or writing there is exception 2.

Addresses between the entries read as 0 and refuse writes with exception 2.
"""
