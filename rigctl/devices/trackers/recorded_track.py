"""A recorded track, played back in the loop's time."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

from rigctl.devices.trackers.streaming_tracker import StreamingTracker
from rigctl.errors import WrongUse
from rigctl.values import Position
from rigctl.wire.tracker_lines import PositionLines


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

    Raises WrongUse where the file cannot be read or has a line that is no position.
    """
    try:
        text = path.read_bytes()
    except OSError as error:
        raise WrongUse(f"cannot read the track {path}: {error.strerror}") from error
    lines = [line for line in text.splitlines() if line.strip()]
    if lines and lines[0].lstrip()[:1].isalpha():
        del lines[0]
    decoder = PositionLines()
    positions = []
    for number, line in enumerate(lines, start=1):
        readings = decoder.feed(line + b"\n")
        if len(readings) != 1:
            raise WrongUse(f"{path}: position {number} is not time_ms,x,y,z or time_ms,x,y,z,valid")
        time_ms, x, y, z, valid = readings[0]
        positions.append(Position(time_ms / 1000.0, x, y, z, valid))
    return positions
