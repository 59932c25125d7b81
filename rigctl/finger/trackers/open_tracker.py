"""Any tracker from one line of text."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator, Sequence
from io import BytesIO
from itertools import pairwise
from pathlib import Path
from typing import Protocol
from urllib.parse import parse_qsl

from rigctl.boards.links import SCHEME, ByteLink, SerialLink, TcpLink
from rigctl.config.text_file import read_bytes
from rigctl.errors import WrongUse
from rigctl.finger.trackers.lines import PositionLines
from rigctl.finger.trackers.streaming import (
    OpenVrTracker,
    SerialTracker,
    StreamingTracker,
    UdpTracker,
)
from rigctl.finger.trackers.tracker import Tracker
from rigctl.plugins import Lookup, installed
from rigctl.values import Position

MAX_TRACK_BYTES = 64 * 1024 * 1024
MAX_LINES = 500_000
"""More than half an hour at 250 positions a second."""


class RecordedTrack(StreamingTracker):
    """Positions of a track, each at its time after the first, which comes on opening.

    ``positions`` have ascending times of any origin. At its end the tracker is lost.
    """

    def __init__(
        self, positions: Sequence[Position], loop: asyncio.AbstractEventLoop, name: str = "track"
    ) -> None:
        super().__init__(name, loop)
        if not positions or any(b.at_s <= a.at_s for a, b in pairwise(positions)):
            raise WrongUse(f"{name}: a track needs positions with ascending times")
        self._positions = positions
        self._begins_s = 0.0
        self._next = 0
        self._timer: asyncio.TimerHandle | None = None

    def _begin(self) -> None:
        self._begins_s = self._loop.time() - self._positions[0].at_s
        self._next = 0
        self._schedule()

    def _end(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _schedule(self) -> None:
        self._timer = self._loop.call_at(self._due_s(), self._play)

    def _due_s(self) -> float:
        return self._begins_s + self._positions[self._next].at_s

    def _play(self) -> None:
        """Deliver what is due, in its own time, even where the loop is late."""
        self._watch.heard_s = self._loop.time()
        while self._next < len(self._positions) and self._due_s() <= self._loop.time():
            position = self._positions[self._next]._replace(at_s=self._due_s())
            self._next += 1
            self._deliver(position)
            if not self.is_open:
                return
        if self._next == len(self._positions):
            self._lose(f"{self.name}: the recorded track has ended")
        else:
            self._schedule()

    def _fall_silent(self) -> None:
        """Wait on: the recorded tracker was silent."""


def read_track(path: Path) -> list[Position]:
    """Return the positions of a CSV file of ``time_ms,x,y,z[,valid]``, its header line optional.

    Raises WrongUse where the file cannot be read, has a line that is no position, or has
    too many.
    """
    decoder = PositionLines()
    positions: list[Position] = []
    text = read_bytes(path, MAX_TRACK_BYTES)
    if text.count(b"\n") > MAX_LINES:
        raise WrongUse(f"{path}: a track has at most {MAX_LINES:,} lines: cut it")
    for line in _track_lines(text):
        readings = decoder.feed(line + b"\n")
        number = len(positions) + 1
        if len(readings) != 1:
            raise WrongUse(f"{path}: position {number} is not time_ms,x,y,z or time_ms,x,y,z,valid")
        time_ms, x, y, z, valid = readings[0]
        positions.append(Position(time_ms / 1000.0, x, y, z, valid))
    return positions


def _track_lines(text: bytes) -> Iterator[bytes]:
    """Yield the lines that are neither empty nor the header."""
    lines = (line.rstrip(b"\r\n") for line in BytesIO(text))
    filled = (line for line in lines if line.strip())
    first = next(filled, b"")
    if first and not first.lstrip()[:1].isalpha():
        yield first
    yield from filled


SPECS = "serial:PORT, udp:PORT, file:PATH, imu:PORT, vive or vive:SERIAL"
DEFAULT_BAUD = 115_200
LONGEST_LATENCY_MS = 90.0
"""A velocity is due within the batch after its own."""


class OpenTracker(Protocol):
    """Makes the tracker, not yet open, that a text behind its name and a colon describes."""

    def __call__(self, text: str, loop: asyncio.AbstractEventLoop) -> Tracker:
        """Return the tracker. Raises WrongUse for a text that describes none."""
        ...


_OURS = "serial", "udp", "file", "imu", "vive"
TRACKERS: Lookup[OpenTracker | None] = Lookup("tracker", dict.fromkeys(_OURS), OpenTracker)
"""What the first word of a tracker's text names; :func:`open_tracker` knows ours itself."""


def open_tracker(spec: str, loop: asyncio.AbstractEventLoop) -> Tracker:
    """Return the tracker, not yet open, that ``spec`` names: ``serial:/dev/ttyACM1``.

    Sources with a port take options: ``serial:/dev/ttyACM1?baud=921600&latency_ms=8``. Raises
    WrongUse for a text that names none.
    """
    kind, _, rest = spec.partition(":")
    others = TRACKERS.load(kind) if kind in TRACKERS.names else None
    if others is not None:
        with TRACKERS.blamed(kind):
            return others(rest, loop)
    if kind == "file":
        path = Path(rest)
        return RecordedTrack(read_track(path), loop, f"track {path.name}")
    if kind == "vive":
        return OpenVrTracker(loop, rest)
    place, _, query = rest.partition("?")
    options = _Options(spec, query)
    baud, latency_s = options.baud, options.latency_s
    if kind == "serial" and place:
        return SerialTracker(_link(place, baud, loop), loop, latency_s)
    if kind == "imu" and place:
        from rigctl.finger.trackers.imu import ImuTracker  # with SciPy's rotations

        return ImuTracker(_link(place, baud, loop), loop, latency_s)
    if kind == "udp" and place.isdecimal() and 0 < int(place) < 65536:
        return UdpTracker(int(place), loop, latency_s)
    names = "".join(f", {plugin.name}:…" for plugin in installed(TRACKERS.kind))
    raise WrongUse(f"{spec!r} names no tracker: write {SPECS}{names}")


class _Options:
    """Options behind the question mark of a tracker's text."""

    def __init__(self, spec: str, query: str) -> None:
        self._spec = spec
        self._given = dict(parse_qsl(query, keep_blank_values=True))
        unknown = self._given.keys() - {"baud", "latency_ms"}
        if unknown or (query and not self._given):
            raise WrongUse(f"{spec!r}: options are baud and latency_ms")
        self.baud = round(self._number("baud", DEFAULT_BAUD, 300, 12e6))
        self.latency_s = self._number("latency_ms", 0.0, 0.0, LONGEST_LATENCY_MS) / 1000.0

    def _number(self, name: str, default: float, low: float, high: float) -> float:
        try:
            value = float(self._given.get(name, default))
        except ValueError:
            value = float("nan")
        if not low <= value <= high:
            raise WrongUse(f"{self._spec!r}: {name} must be a number from {low:g} to {high:g}")
        return value


def _link(port: str, baud: int, loop: asyncio.AbstractEventLoop) -> ByteLink:
    return TcpLink(port, loop) if port.startswith(SCHEME) else SerialLink(port, baud, loop)
