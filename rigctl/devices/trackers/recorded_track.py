"""A recorded track, played back in the loop's time."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator, Sequence
from io import BytesIO
from itertools import pairwise
from pathlib import Path

from rigctl.config.text_file import read_bytes
from rigctl.devices.trackers.streaming_tracker import StreamingTracker
from rigctl.errors import WrongUse
from rigctl.values import Position
from rigctl.wire.tracker_lines import PositionLines

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
