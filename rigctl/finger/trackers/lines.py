"""Lines of numbers that trackers send: bytes to values, in slices of any length.

``docs/reference/trackers.md`` describes the lines. A line that is not what it should be is
counted and costs only itself. A line may end in a checksum, as those of NMEA 0183 do; without one
a digit that changed on its way cannot be noticed.
"""

from __future__ import annotations

import re
from functools import reduce
from operator import xor
from typing import NamedTuple

MAX_LINE = 200
"""Bytes of a line without its end; a longer one is malformed."""
_NUMBER = re.compile(rb"[+-]?(?:\d{1,15}(?:\.\d{0,15})?|\.\d{1,15})(?:[eE][+-]?\d{1,2})?")
_CHECKSUM = re.compile(rb"\*([0-9A-Fa-f]{2})\Z")
_LARGEST = 1e15


class NumberLines:
    """Decodes lines of comma-separated numbers with ``low`` to ``high`` fields.

    ``joins``: the stream is joined in the middle of a line, so what comes before the first end
    of a line is dropped and not counted. After the first line with a checksum, all need one.
    """

    def __init__(self, low: int, high: int, joins: bool = False) -> None:
        self.malformed = 0
        self._fields = range(low, high + 1)
        self._joins = joins
        self._checks = False
        self._tail = b""

    def feed(self, data: bytes) -> list[tuple[float, ...]]:
        """Return the numbers of each whole line, in order."""
        *lines, tail = (self._tail + data).split(b"\n")
        # Of an endless line, no more than shows that it is too long.
        self._tail = tail[: MAX_LINE + 2]
        if lines and self._joins:
            del lines[0]
            self._joins = False
        decoded = [self._decode(line) for line in lines]
        return [numbers for numbers in decoded if numbers is not None]

    def _decode(self, line: bytes) -> tuple[float, ...] | None:
        text = self._strip_checksum(line.removesuffix(b"\r"))
        fields = [field.strip(b" \t") for field in text.split(b",")]
        fits = len(line) <= MAX_LINE and len(fields) in self._fields
        if fits and all(_NUMBER.fullmatch(field) for field in fields):
            numbers = tuple(float(field) for field in fields)
            if all(abs(number) <= _LARGEST for number in numbers):
                return numbers
        self.malformed += 1
        return None

    def _strip_checksum(self, line: bytes) -> bytes:
        """Return a line without its checksum, the XOR of its bytes; empty where it is wrong."""
        found = _CHECKSUM.search(line)
        if found is None:
            return b"" if self._checks else line
        text = line[: found.start()]
        if reduce(xor, text, 0) != int(found[1], 16):
            return b""
        self._checks = True
        return text


class TrackerReading(NamedTuple):
    """A position with the tracker's own time."""

    time_ms: float
    x_mm: float
    y_mm: float
    z_mm: float
    valid: bool


class PositionLines:
    """Decodes ``time_ms,x,y,z`` with an optional ``,valid`` of 0 or 1."""

    def __init__(self, joins: bool = False) -> None:
        self._lines = NumberLines(4, 5, joins)
        self._bad_flags = 0

    @property
    def malformed(self) -> int:
        """Lines that are no position."""
        return self._lines.malformed + self._bad_flags

    def feed(self, data: bytes) -> list[TrackerReading]:
        """Return the position of each whole line, in order."""
        readings = [_reading(numbers) for numbers in self._lines.feed(data)]
        self._bad_flags += readings.count(None)
        return [reading for reading in readings if reading is not None]


class ImuReading(NamedTuple):
    """Acceleration in m/s² and rate of turn in rad/s along the sensor's axes, and its time."""

    time_ms: float
    acceleration_m_s2: tuple[float, float, float]
    turn_rad_s: tuple[float, float, float]


class ImuLines:
    """Decodes ``time_ms,ax,ay,az,gx,gy,gz``."""

    def __init__(self) -> None:
        self._lines = NumberLines(7, 7, joins=True)

    @property
    def malformed(self) -> int:
        """Lines that are no reading."""
        return self._lines.malformed

    def feed(self, data: bytes) -> list[ImuReading]:
        """Return the reading of each whole line, in order."""
        return [
            ImuReading(time_ms, (ax, ay, az), (gx, gy, gz))
            for time_ms, ax, ay, az, gx, gy, gz in self._lines.feed(data)
        ]


def decode_datagram(data: bytes) -> tuple[int, TrackerReading] | None:
    """Return number and position of a datagram ``sequence,time_ms,x,y,z[,valid]``, one line.

    None for anything else.
    """
    lines = NumberLines(5, 6).feed(data.removesuffix(b"\n") + b"\n")
    if len(lines) != 1:
        return None
    sequence, *numbers = lines[0]
    reading = _reading(tuple(numbers))
    if reading is None or sequence < 0 or not sequence.is_integer():
        return None
    return int(sequence), reading


def _reading(numbers: tuple[float, ...]) -> TrackerReading | None:
    time_ms, x, y, z, *flag = numbers
    if flag not in ([], [0.0], [1.0]):
        return None
    return TrackerReading(time_ms, x, y, z, flag != [0.0])
