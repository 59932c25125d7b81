"""The drum's Modbus register table: the single truth of the drum's wire.

``arduino/drum/drum_map.h`` is generated from :data:`REGISTERS`
(``python -m rigctl.wire.codegen``), a test fails when the header is stale, and
``docs/reference/drum-wire.md`` renders the same table. Registers are 16 bits wide; a 32-bit
value takes two, high word first. Addresses are those on the wire (the first register is 0).
A value in engineering units is the register's integer times ``scale``.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from rigctl.values import SCALE_BAND_UG_PER_COUNT

MAGIC = 0x5247
MAP_VERSION = 3
BOARD_DRUM = 1
BOARD_TAXELS = 2
UNIT = 1
BAUD = 115200
LOADCELL_RECENT = 5
RING_DEPTH = 64
TARE_PLACES = 16


class Command(IntEnum):
    """Values of register ``command``; executed when ``command_sequence`` is written anew."""

    NONE = 0
    ARM = 1
    DISARM = 2
    MOVE = 3
    APPROACH = 4
    RUN = 5
    RETRACT = 6
    STOP = 7
    CLEAR = 8
    TARE = 9
    ZERO_STEPS = 10
    HOME = 11
    SAVE = 12
    DEFAULTS = 13
    TUNE = 14
    TARE_TURN = 15
    TARE_ANYWAY = 16


class CommandResult(IntEnum):
    """Values of ``command_result``; valid once ``command_acknowledged`` shows the sequence."""

    NONE = 0
    DONE = 1
    RUNNING = 2
    WRONG_STATE = 3
    FAILED = 4


class ForceMode(IntEnum):
    """Values of register ``force_mode``."""

    HOLD = 0
    LOCK = 1
    POSITION = 2


class Signal(IntEnum):
    """Bit numbers of registers ``optional_signals`` (fitted) and ``signal_polarity`` (inverted)."""

    ESTOP = 0
    INDEX = 1
    END_SWITCHES = 2
    POSITION = 3
    SYNC = 4


class SettingsFrom(IntEnum):
    """Values of register ``settings_from``."""

    DEFAULTS = 0
    SAVED = 1
    DAMAGED = 2


class Status(IntEnum):
    """Bit numbers of register ``status_bits``."""

    SYNC_HIGH = 0
    INDEX_HIGH = 1
    FORCE_SETTLED = 2
    IN_CONTACT = 3
    SPEED_CONSTANT = 4
    ESTOP_CLOSED = 5
    END_UP = 6
    END_DOWN = 7
    HOMED = 8
    TARED = 9
    CONTACT_MAY_STAND = 10
    LIFT_FAILED = 11


class Guard(IntEnum):
    """When a setting may be changed; writing the value that it has is harmless always.

    RESTING: in IDLE or ARMED, the emergency stop closed, and no contact known to stand; after a
    boot, when nothing is known, too. LIFTED: the same, and known to be lifted.
    """

    NONE = 0
    RESTING = 1
    LIFTED = 2


class ResetCause(IntEnum):
    """Bit numbers of register ``reset_cause`` (MCUSR, ATmega2560 datasheet §12.5.1)."""

    POWER_ON = 0
    EXTERNAL = 1
    BROWN_OUT = 2
    WATCHDOG = 3
    JTAG = 4


@dataclass(frozen=True, slots=True)
class Register:
    """One value on the drum's wire.

    ``kind`` is u16, i16, u32 or i32; ``low`` and ``high`` bound what may be written, in raw
    integers, and ``least`` its magnitude; ``default`` is what the board boots with; ``guard``
    says when it may be changed.
    """

    name: str
    address: int
    kind: str
    unit: str
    scale: float
    doc: str
    writable: bool = False
    low: int = 0
    high: int = 0
    default: int = 0
    count: int = 1
    least: int = 0
    guard: Guard = Guard.NONE

    @property
    def words(self) -> int:
        """Registers that one value takes."""
        return 2 if self.kind in ("u32", "i32") else 1

    @property
    def end(self) -> int:
        """First address behind this entry."""
        return self.address + self.words * self.count

    def takes(self, raw: int) -> bool:
        """True where ``raw`` is within what may be written."""
        return self.low <= raw <= self.high and abs(raw) >= self.least


def _ro(
    address: int, name: str, kind: str, unit: str, doc: str, scale: float = 1, count: int = 1
) -> Register:
    return Register(name, address, kind, unit, scale, doc, count=count)


def _rw(
    address: int,
    name: str,
    kind: str,
    unit: str,
    doc: str,
    bounds: tuple[int, int, int],
    scale: float = 1,
    guard: Guard = Guard.NONE,
    least: int = 0,
) -> Register:
    low, high, default = bounds
    return Register(
        name, address, kind, unit, scale, doc, True, low, high, default, least=least, guard=guard
    )


IDENTITY = (
    _ro(0, "magic", "u16", "", "0x5247, ASCII RG: this is a rigctl board"),
    _ro(1, "map_version", "u16", "", "version of this table; the host refuses another"),
    _ro(2, "board_id", "u16", "", "1: drum"),
    _ro(3, "firmware_version", "u16", "", "major × 256 + minor"),
    _ro(4, "build_hash", "u32", "", "first 32 bits of the hash of the sources built"),
    _ro(6, "boot_count", "u16", "", "boots since the EEPROM was erased, wraps"),
    _ro(7, "reset_cause", "u16", "", "bits of ResetCause, kept from before the bootloader"),
    _ro(8, "ring_depth", "u16", "", "load-cell samples kept in the ring"),
    _ro(9, "steps_per_turn", "u16", "steps", "microsteps of one drum turn"),
    _ro(10, "nm_per_step", "u32", "nm", "texture travel of one microstep at the drum's surface"),
    _ro(12, "most_force", "u16", "g", "force that the board lifts at, whatever settings say"),
    _ro(13, "overrun_um", "u16", "µm", "farthest travel from that force until the drum stands"),
)

POLL = (
    _ro(16, "state", "u16", "", "value of State"),
    _ro(17, "fault", "u16", "", "first latched Fault, 0 when none"),
    _ro(18, "fault_at_ms", "u32", "ms", "board time of the first fault"),
    _ro(20, "fault_bits", "u16", "", "causes present now, bit n is fault n"),
    _ro(21, "board_time_us", "u32", "µs", "board clock at the reply, wraps after 71.6 minutes"),
    _ro(23, "steps", "i32", "steps", "signed microsteps since ZERO_STEPS or boot"),
    _ro(25, "angle", "u16", "°", "drum angle from the steps", 0.01),
    _ro(26, "speed", "i16", "mm/s", "surface speed commanded to the stepper now", 0.01),
    _ro(27, "force", "i16", "g", "newest load-cell reading after tare and scale", 0.1),
    _ro(28, "actuator_position_um", "u16", "µm", "actuator travel from its upper end"),
    _ro(29, "actuator_drive", "i16", "permille", "signed duty, positive presses"),
    _ro(30, "command_acknowledged", "u16", "", "last command_sequence seen"),
    _ro(31, "command_result", "u16", "", "value of CommandResult for that sequence"),
    _ro(32, "sync_count", "u16", "", "rises of the sync line since boot, wraps"),
    _ro(33, "sync_rise_us", "u32", "µs", "board time of the last rise"),
    _ro(35, "sync_fall_us", "u32", "µs", "board time of the last fall"),
    _ro(37, "index_count", "u16", "", "index marks seen since boot, wraps"),
    _ro(38, "loadcell_sequence", "u16", "", "number of the newest load-cell sample, wraps"),
    _ro(39, "loadcell_time_us", "u32", "µs", "board time at which the newest sample was ready"),
    _ro(41, "loadcell_recent", "i32", "counts", "newest raw samples, newest first", count=5),
    _ro(51, "heartbeat_seen", "u16", "", "last heartbeat value received"),
    _ro(52, "crc_errors", "u16", "", "requests dropped for a bad CRC, wraps"),
    _ro(53, "late_ticks", "u16", "", "1 kHz ticks that started a period late or more, wraps"),
    _ro(54, "status_bits", "u16", "", "bits of Status"),
    _ro(55, "last_contact_um", "u16", "µm", "actuator travel at the last contact"),
)

SETTINGS = (
    _rw(64, "heartbeat", "u16", "", "any change counts as a beat; 0 is allowed", (0, 65535, 0)),
    _rw(65, "command", "u16", "", "value of Command, executed with the next register", (0, 16, 0)),
    _rw(66, "command_sequence", "u16", "", "a new value executes the command", (0, 65535, 0)),
    _rw(
        67,
        "signal_polarity",
        "u16",
        "",
        "bits of Signal: wired the other way",
        (0, 31, 0),
        guard=Guard.RESTING,
    ),
    _rw(68, "speed_set", "u16", "mm/s", "surface speed of RUN", (500, 20000, 8000), 0.01),
    _rw(69, "force_set", "u16", "g", "force of APPROACH, HOLD and RUN", (500, 15000, 5000), 0.1),
    _rw(70, "acceleration_set", "u16", "mm/s²", "of every ramp", (50, 2000, 600)),
    _rw(71, "direction_set", "u16", "", "0 forwards, 1 backwards", (0, 1, 0)),
    _rw(72, "force_mode", "u16", "", "value of ForceMode", (0, 2, 0), guard=Guard.RESTING),
    _rw(73, "travel_set", "u16", "mm", "texture travel while sync is high", (10, 6000, 2450), 0.1),
    _rw(74, "run_in_set", "u16", "mm", "travel from RUN to the rise of sync", (0, 2000, 1000), 0.1),
    _rw(
        75,
        "depth_set_um",
        "u16",
        "µm",
        "actuator depth below contact, force_mode 2",
        (0, 10000, 1000),
        guard=Guard.RESTING,
    ),
    _rw(76, "move_target", "i32", "steps", "target of MOVE", (-2000000, 2000000, 0)),
    _rw(
        78,
        "move_speed_set",
        "u16",
        "mm/s",
        "surface speed of MOVE, lifted",
        (500, 32000, 20000),
        0.01,
    ),
    _rw(
        79,
        "clock_trim_ppm",
        "i16",
        "ppm",
        "board clock fast by so much: rates are lowered by it",
        (-10000, 10000, 0),
    ),
    _rw(80, "settle_band", "u16", "permille", "force band that counts as settled", (2, 200, 20)),
    _rw(
        81,
        "settle_time_ms",
        "u16",
        "ms",
        "time inside the band that counts as settled",
        (50, 5000, 300),
    ),
    _rw(
        82,
        "approach_limit_um",
        "u16",
        "µm",
        "actuator travel without contact that is a fault",
        (500, 50000, 30000),
    ),
    _rw(
        83,
        "approach_timeout_ms",
        "u16",
        "ms",
        "time to settle that is a fault",
        (500, 30000, 10000),
    ),
    _rw(
        84,
        "over_force",
        "u16",
        "g",
        "force that lifts at once; the board's own limit stands besides",
        (1000, 30000, 14000),
        0.1,
        guard=Guard.RESTING,
    ),
    _rw(85, "lift_clearance_um", "u16", "µm", "lift above the last contact", (500, 20000, 3000)),
    _rw(
        86,
        "tare_counts",
        "i32",
        "counts",
        "raw reading at no load",
        (-8388608, 8388607, 0),
        guard=Guard.LIFTED,
    ),
    _rw(
        88,
        "scale_ug_per_count",
        "i32",
        "µg/count",
        "load-cell scale, sign included",
        (-SCALE_BAND_UG_PER_COUNT[1], SCALE_BAND_UG_PER_COUNT[1], 2400),
        guard=Guard.RESTING,
        least=SCALE_BAND_UG_PER_COUNT[0],
    ),
    _rw(
        90,
        "gain_p",
        "u16",
        "1/s",
        "approach rate per force error over stiffness",
        (1, 5000, 600),
        0.01,
    ),
    _rw(
        91,
        "gain_i",
        "u16",
        "1/s",
        "rate learned per unforeseen compression, each load-cell sample",
        (0, 5000, 500),
        0.01,
    ),
    _rw(
        92,
        "stiffness_g_per_mm",
        "u16",
        "g/mm",
        "contact stiffness: start value, then the estimate",
        (50, 5000, 900),
    ),
    _rw(
        93,
        "dead_band_permille",
        "u16",
        "permille",
        "least duty that moves the actuator: start value of the board's own estimate",
        (0, 500, 100),
    ),
    _rw(
        94, "heartbeat_limit_ms", "u16", "ms", "silence that ramps down and lifts", (100, 250, 250)
    ),
    _rw(
        95,
        "optional_signals",
        "u16",
        "",
        "bits of Signal: fitted",
        (0, 31, 31),
        guard=Guard.RESTING,
    ),
    _rw(
        96,
        "run_settle_ms",
        "u16",
        "ms",
        "time at constant speed that the run-in must hold besides the ramp",
        (0, 2000, 100),
    ),
    *(
        _rw(
            97 + place,
            f"tare_place_{place:02d}",
            "i16",
            "counts",
            f"reading at no load less tare_counts, {place}/{TARE_PLACES} of a turn behind the mark",
            (-32768, 32767, 0),
            guard=Guard.LIFTED,
        )
        for place in range(TARE_PLACES)
    ),
)

COUNTERS = (
    _ro(116, "frames_seen", "u16", "", "requests for this unit with a good CRC, wraps"),
    _ro(117, "exceptions_sent", "u16", "", "requests refused, wraps"),
    _ro(118, "longest_isr_us", "u16", "µs", "longest interrupt since boot"),
    _ro(119, "free_stack_bytes", "u16", "bytes", "stack never used since boot (painted)"),
    _ro(120, "idle_permille", "u16", "permille", "share of the last second spent waiting"),
    _ro(121, "loadcell_dropped", "u16", "", "conversions not used, wraps"),
    _ro(122, "index_error_steps", "i16", "steps", "last index mark: steps counted less expected"),
    _ro(123, "proposed_gain_p", "u16", "1/s", "gain_p that the last TUNE proposes, 0: none", 0.01),
    _ro(124, "proposed_gain_i", "u16", "1/s", "gain_i that the last TUNE proposes, 0: none", 0.01),
    _ro(125, "tuned_stiffness_g_per_mm", "u16", "g/mm", "force per travel asked for, last TUNE"),
    _ro(126, "tuned_delay", "u16", "ms", "from a speed asked for to its force, last TUNE", 0.1),
    _ro(127, "settings_from", "u16", "", "value of SettingsFrom: what the board booted with"),
)

RING = (
    _ro(128, "ring_raw", "i32", "counts", "load-cell sample n at n mod 64", count=RING_DEPTH),
    _ro(
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
"""First address and count of the one read that every poll makes."""
SETTINGS_BLOCK = (64, 49)
COUNTERS_BLOCK = (116, 12)
END = 384
"""First address that does not exist; reading or writing there is exception 2.

Addresses between the entries read as 0 and refuse writes with exception 2.
"""
