"""The drum's Modbus register table, the only definition of the drum's registers.

``python -m rigctl.boards.codegen`` generates ``arduino/drum/drum_map.h`` and
``docs/reference/drum-wire.md`` from it; a test fails when they are stale. Registers are 16 bits
wide; a 32-bit value takes two, high word first. Addresses count from 0 as on the wire. A value
in engineering units is the register's integer times ``scale``.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from rigctl.boards.drum_codes import Guard
from rigctl.errors import WrongUse
from rigctl.values import SCALE_BAND_UG_PER_COUNT

MAGIC = 0x5247
MAP_VERSION = 5
BOARD_DRUM = 1
BOARD_TAXELS = 2
UNIT = 1
BAUD = 115200
LOADCELL_RECENT = 5
RING_DEPTH = 64
TARE_PLACES = 16
RESTING, LIFTED = Guard.RESTING, Guard.LIFTED


@dataclass(frozen=True, slots=True)
class Register:
    """One value of the drum, ``count`` values of the same kind for an array.

    ``kind`` is u16, i16, u32 or i32. ``low`` and ``high`` bound what may be written, ``least``
    bounds its magnitude, ``default`` is the value at boot: all are raw integers. ``guard`` says
    when the value may be changed.

    Of a polled one, ``shown`` is its name in the status and the window's health strip, empty for
    none, and ``stored`` says that ``/drum`` of a session has a column of it, in its unit.
    """

    address: int
    name: str
    doc: str
    unit: str = ""
    scale: float = 1
    kind: str = "u16"
    count: int = 1
    writable: bool = False
    low: int = 0
    high: int = 0
    default: int = 0
    least: int = 0
    guard: Guard = Guard.NONE
    shown: str = ""
    stored: bool = False

    @property
    def words(self) -> int:
        """Registers of 16 bits that one value takes."""
        return 2 if self.kind in ("u32", "i32") else 1

    @property
    def end(self) -> int:
        """First address behind this entry."""
        return self.address + self.words * self.count

    def accepts(self, raw: int) -> bool:
        """Return whether ``raw`` is within the bounds of what may be written."""
        return self.low <= raw <= self.high and abs(raw) >= self.least


def setting(
    address: int,
    name: str,
    doc: str,
    bounds: tuple[int, int, int],
    unit: str = "",
    scale: float = 1,
    kind: str = "u16",
    least: int = 0,
    guard: Guard = Guard.NONE,
) -> Register:
    """Return a setting; ``bounds`` are low, high and default as raw integers."""
    return Register(address, name, doc, unit, scale, kind, 1, True, *bounds, least, guard)


IDENTITY = (
    Register(0, "magic", "0x5247, ASCII RG: this is a rigctl board"),
    Register(1, "map_version", "version of this table; the host refuses another"),
    Register(2, "board_id", "1: drum"),
    Register(3, "firmware_version", "major × 256 + minor"),
    Register(4, "build_hash", "first 32 bits of the hash of the sources built", kind="u32"),
    Register(6, "boot_count", "boots since the EEPROM was erased, wraps"),
    Register(
        7, "reset_cause", "bits of ResetCause; 0: the bootloader cleared them, and it was no hang"
    ),
    Register(8, "ring_depth", "load-cell samples kept in the ring"),
    Register(9, "steps_per_turn", "microsteps of one drum turn", "steps"),
    Register(
        10, "nm_per_step", "texture travel of one microstep at the drum's surface", "nm", kind="u32"
    ),
    Register(12, "most_force", "force at which the board lifts with any settings", "g"),
    Register(13, "overrun_um", "longest travel from that force until the drum stops", "µm"),
)

POLL = (
    Register(16, "state", "value of State"),
    Register(17, "fault", "first latched Fault, 0 if none; HEARTBEAT gives way to any other"),
    Register(18, "fault_at_ms", "board time of that fault", "ms", kind="u32"),
    Register(20, "fault_bits", "causes present now, bit n is fault n", kind="u32"),
    Register(
        22, "board_time_us", "board clock at the reply, wraps after 71.6 minutes", "µs", kind="u32"
    ),
    Register(24, "steps", "signed microsteps since ZERO_STEPS or boot", "steps", kind="i32"),
    Register(26, "angle", "drum angle from the steps", "°", 0.01),
    Register(27, "speed", "surface speed commanded to the stepper now", "mm/s", 0.01, kind="i16"),
    Register(28, "force", "newest load-cell reading after tare and scale", "g", 0.1, kind="i16"),
    Register(29, "actuator_position_um", "actuator travel from its upper end", "µm"),
    Register(30, "actuator_drive", "signed duty, positive presses", "permille", kind="i16"),
    Register(31, "command_acknowledged", "last command_sequence seen"),
    Register(32, "command_result", "value of CommandResult for that sequence"),
    Register(33, "sync_count", "rises of the sync line since boot, wraps"),
    Register(34, "sync_rise_us", "board time of the last rise", "µs", kind="u32"),
    Register(36, "sync_fall_us", "board time of the last fall", "µs", kind="u32"),
    Register(38, "index_count", "index marks seen since boot, wraps"),
    Register(39, "loadcell_sequence", "number of the newest load-cell sample, wraps"),
    Register(
        40, "loadcell_time_us", "board time at which the newest sample was ready", "µs", kind="u32"
    ),
    Register(
        42,
        "loadcell_recent",
        "newest raw samples first",
        "counts",
        kind="i32",
        count=LOADCELL_RECENT,
    ),
    Register(52, "heartbeat_seen", "last heartbeat value received"),
    Register(53, "crc_errors", "requests dropped for a bad CRC, wraps"),
    Register(54, "status_bits", "bits of Status"),
    Register(55, "last_contact_um", "actuator travel at the last contact", "µm"),
)

SETTINGS = (
    setting(64, "heartbeat", "any change counts as a beat; 0 is allowed", (0, 65535, 0)),
    setting(65, "command", "value of Command, executed with the next register", (0, 19, 0)),
    setting(66, "command_sequence", "a new value executes the command", (0, 65535, 0)),
    setting(67, "signal_polarity", "bits of Signal: inverted", (0, 31, 0), guard=RESTING),
    setting(68, "speed_set", "surface speed of RUN", (500, 20000, 8000), "mm/s", 0.01),
    setting(69, "force_set", "force of APPROACH, HOLD and RUN", (500, 15000, 5000), "g", 0.1),
    setting(70, "acceleration_set", "acceleration of every ramp", (50, 2000, 600), "mm/s²"),
    setting(71, "direction_set", "0 forwards, 1 backwards", (0, 1, 0)),
    setting(72, "force_mode", "value of ForceMode", (0, 2, 0), guard=RESTING),
    setting(73, "travel_set", "texture travel while sync is high", (10, 6000, 2450), "mm", 0.1),
    setting(74, "run_in_set", "travel from RUN to the rise of sync", (0, 2000, 1000), "mm", 0.1),
    setting(
        75, "depth_set_um", "pressing depth, force_mode 2", (0, 10000, 1000), "µm", guard=RESTING
    ),
    setting(76, "move_target", "target of MOVE", (-2000000, 2000000, 0), "steps", kind="i32"),
    setting(
        78, "move_speed_set", "surface speed of MOVE, lifted", (500, 32000, 20000), "mm/s", 0.01
    ),
    setting(79, "clock_trim_ppm", "clock error, + is fast", (-10000, 10000, 0), "ppm", kind="i16"),
    setting(80, "settle_band", "force band that counts as settled", (2, 200, 20), "permille"),
    setting(
        81, "settle_time_ms", "time inside the band that counts as settled", (50, 5000, 300), "ms"
    ),
    setting(
        82, "approach_limit_um", "actuator travel that finds no contact", (500, 50000, 30000), "µm"
    ),
    setting(83, "approach_timeout_ms", "longest time to settle", (500, 30000, 10000), "ms"),
    setting(
        84,
        "over_force",
        "force that lifts immediately; the board's own limit applies as well",
        (1000, 30000, 14000),
        "g",
        0.1,
        guard=RESTING,
    ),
    setting(85, "lift_clearance_um", "lift above the last contact", (500, 20000, 3000), "µm"),
    setting(
        86,
        "tare_counts",
        "raw reading at no load",
        (-8388608, 8388607, 0),
        "counts",
        kind="i32",
        guard=LIFTED,
    ),
    setting(
        88,
        "scale_ug_per_count",
        "load-cell scale, sign included",
        (-SCALE_BAND_UG_PER_COUNT[1], SCALE_BAND_UG_PER_COUNT[1], 2400),
        "µg/count",
        kind="i32",
        least=SCALE_BAND_UG_PER_COUNT[0],
        guard=RESTING,
    ),
    setting(
        90, "gain_p", "approach rate per force error over stiffness", (1, 5000, 600), "1/s", 0.01
    ),
    setting(91, "gain_i", "rate learned per unforeseen compression", (0, 5000, 500), "1/s", 0.01),
    setting(
        92, "stiffness_g_per_mm", "contact stiffness, later its estimate", (50, 5000, 900), "g/mm"
    ),
    setting(
        93,
        "dead_band_permille",
        "lowest duty that moves the actuator: start value of the board's own estimate",
        (0, 500, 100),
        "permille",
    ),
    setting(94, "heartbeat_limit_ms", "silence that ramps down and lifts", (100, 250, 250), "ms"),
    setting(95, "optional_signals", "bits of Signal: fitted", (0, 31, 31), guard=RESTING),
    setting(96, "run_settle_ms", "time at constant speed within the run-in", (0, 2000, 100), "ms"),
    *(
        setting(
            97 + place,
            f"tare_place_{place:02d}",
            f"reading at no load less tare_counts, {place}/{TARE_PLACES} of a turn behind the mark",
            (-32768, 32767, 0),
            "counts",
            kind="i16",
            guard=LIFTED,
        )
        for place in range(TARE_PLACES)
    ),
    setting(113, "nudge_direction", "of NUDGE: 0 lifts, 1 presses", (0, 1, 0)),
    setting(
        114,
        "loadcell_slow",
        "the HX711's RATE pin: 0 high, 80 samples a second; 1 low, 10 a second",
        (0, 1, 0),
        guard=RESTING,
    ),
)

COUNTERS = (
    Register(116, "frames_seen", "requests for this unit with a good CRC, wraps"),
    Register(117, "exceptions_sent", "requests refused, wraps"),
    Register(118, "longest_isr_us", "longest interrupt since boot", "µs"),
    Register(119, "free_stack_bytes", "stack never used since boot (painted)", "bytes"),
    Register(120, "idle_permille", "share of the last second spent waiting", "permille"),
    Register(121, "loadcell_dropped", "conversions not used, wraps"),
    Register(
        122, "index_error_steps", "last mark: steps counted less expected", "steps", kind="i16"
    ),
    Register(123, "proposed_gain_p", "gain_p that the last TUNE proposes, 0: none", "1/s", 0.01),
    Register(124, "proposed_gain_i", "gain_i that the last TUNE proposes, 0: none", "1/s", 0.01),
    Register(125, "tuned_stiffness_g_per_mm", "force per commanded travel, last TUNE", "g/mm"),
    Register(126, "tuned_delay", "from a commanded speed to its force, last TUNE", "ms", 0.1),
    Register(127, "settings_from", "value of SettingsFrom: what the board booted with"),
    Register(128, "late_ticks", "1 kHz ticks that started a period late or more, wraps"),
    Register(129, "settings_hash", "of what COMMISSION binds to: wires, scale, board", kind="u32"),
    Register(131, "loadcell_rate", "measured conversions, 0: not yet", "samples/s", 0.01),
    Register(132, "loadcell_spikes", "single samples far from both neighbours, wraps"),
    Register(133, "loadcell_noise", "standard deviation of the ring", "counts", 0.1),
    Register(134, "loadcell_unique", "distinct values among the last 64"),
    Register(135, "position_raw", "the potentiometer's last reading, 0 to 1023", "counts"),
    Register(136, "nudge_travel_um", "travel of the last nudge, + is downwards", "µm", kind="i16"),
    Register(137, "nudge_duty", "duty at which the rod began to move in it", "permille"),
    Register(
        138,
        "tuned_dead_band",
        "duty below which the rod rests, by its speeds, last TUNE",
        "permille",
    ),
    Register(
        139,
        "tuned_stiction",
        "more duty that the last nudge needed to begin, last TUNE",
        "permille",
    ),
    Register(
        140, "tuned_rate", "actuator's speed at full duty, by its lifts, last TUNE", "mm/s", 0.01
    ),
)

RING = (
    Register(160, "ring_raw", "sample n at place n mod 64", "counts", kind="i32", count=RING_DEPTH),
    Register(288, "ring_time_us", "board time of that sample", "µs", kind="u32", count=RING_DEPTH),
)

REGISTERS: tuple[Register, ...] = IDENTITY + POLL + SETTINGS + COUNTERS + RING
BY_NAME: dict[str, Register] = {register.name: register for register in REGISTERS}
IDENTITY_BLOCK = (0, 14)
POLL_BLOCK = (POLL[0].address, POLL[-1].end - POLL[0].address)
"""First address and count of the read of every poll."""
SHOWN = tuple(register for register in POLL if register.shown)
STORED = tuple(register for register in POLL if register.stored)
SETTINGS_BLOCK = (64, 51)
END = 416
"""First address that does not exist; reading or writing there is exception 2.

Addresses between the entries read as 0 and refuse writes with exception 2.
"""


MAX_WRITE = 24
"""Words of one write, so that every request stays under 64 bytes."""
MAX_READ = POLL_BLOCK[1]

_FORMATS = {"u16": "H", "i16": "h", "u32": "I", "i32": "i"}


@dataclass(frozen=True, slots=True)
class RegisterWrite:
    """Neighbouring registers that one request writes; ``names`` in order of address."""

    address: int
    words: tuple[int, ...]
    names: tuple[str, ...]


def find_register(name: str) -> Register:
    """Return the table's entry of ``name``; raises WrongUse where there is none."""
    found = BY_NAME.get(name)
    if found is None:
        raise WrongUse(f"the drum has no register {name!r}: see docs/reference/drum-wire.md")
    return found


def to_raw(name: str, value: float) -> int:
    """Return the register's integer for ``value`` in engineering units.

    Raises WrongUse for a register that is not writable and for a value out of its bounds.
    """
    entry = find_register(name)
    if not entry.writable:
        raise WrongUse(f"{name} is measured by the drum and cannot be set")
    raw = round(value / entry.scale) if math.isfinite(value) else None
    if raw is None or not entry.accepts(raw):
        unit = f" {entry.unit}" if entry.unit else ""
        raise WrongUse(f"{name} cannot be {value:g}{unit}: the drum takes {_bounds(entry)}{unit}")
    return raw


def _bounds(entry: Register) -> str:
    low, high = entry.low * entry.scale, entry.high * entry.scale
    if not entry.least:
        return f"{low:g} to {high:g}"
    return f"{entry.least * entry.scale:g} to {high:g}, of either sign"


def pack_value(entry: Register, raw: int) -> tuple[int, ...]:
    """Return the register's integer as words, high word first."""
    packed = struct.pack(">" + _FORMATS[entry.kind], raw)
    return struct.unpack(f">{entry.words}H", packed)


def plan_writes(values: Mapping[str, float]) -> list[RegisterWrite]:
    """Return the fewest requests that write ``values``, neighbours in one request.

    Checks every value first; raises as :func:`to_raw`.
    """
    writes: list[RegisterWrite] = []
    for name in sorted(values, key=lambda name: find_register(name).address):
        entry = find_register(name)
        words = pack_value(entry, to_raw(name, values[name]))
        last = writes[-1] if writes else RegisterWrite(-1, (), ())
        joined = last.words + words
        if last.address + len(last.words) == entry.address and len(joined) <= MAX_WRITE:
            writes[-1] = RegisterWrite(last.address, joined, (*last.names, name))
        else:
            writes.append(RegisterWrite(entry.address, words, (name,)))
    return writes


class BlockLayout:
    """The layout of one read of ``count`` registers from ``address``.

    It holds the entries that are wholly inside the read; addresses between them are skipped.
    """

    def __init__(self, address: int, count: int, entries: Iterable[Register] = REGISTERS) -> None:
        self.address, self.count = address, count
        inside = [e for e in entries if e.address >= address and e.end <= address + count]
        self.entries = tuple(sorted(inside, key=lambda entry: entry.address))
        form, end = ">", address
        for entry in self.entries:
            form += "xx" * (entry.address - end) + _FORMATS[entry.kind] * entry.count
            end = entry.end
        self._slices: list[tuple[str, int, int]] = []
        for entry in self.entries:
            start = self._slices[-1][2] if self._slices else 0
            self._slices.append((entry.name, start, start + entry.count))
        self._words = struct.Struct(f">{count}H")
        self._values = struct.Struct(form + "xx" * (address + count - end))

    def unpack(self, words: Sequence[int]) -> dict[str, tuple[int, ...]]:
        """Return the integers of every entry by name; ValueError for a wrong number of words."""
        if len(words) != self.count:
            raise ValueError(f"expected {self.count} registers, received {len(words)}")
        numbers = self._values.unpack(self._words.pack(*words))
        return {name: numbers[start:end] for name, start, end in self._slices}

    def values(self, words: Sequence[int]) -> dict[str, float]:
        """Return every entry by name in engineering units; of an array, the first value."""
        raw = self.unpack(words)
        return {e.name: raw[e.name][0] * e.scale for e in self.entries}


def plan_reads(names: Iterable[str]) -> list[BlockLayout]:
    """Return the fewest reads of at most ``MAX_READ`` registers that hold ``names``."""
    groups: list[list[Register]] = []
    for entry in sorted(map(find_register, names), key=lambda entry: entry.address):
        if groups and entry.end - groups[-1][0].address <= MAX_READ:
            groups[-1].append(entry)
        else:
            groups.append([entry])
    return [BlockLayout(g[0].address, g[-1].end - g[0].address, g) for g in groups]
