"""What all trackers share: callbacks, counters, and the one report that the source is gone."""

from __future__ import annotations

import asyncio
from abc import ABC, abstractmethod

from rigctl.devices.silence_watch import SilenceWatch
from rigctl.devices.trackers.tracker import OnPosition, OnTrackerLost, TrackerCounters
from rigctl.errors import LinkLost
from rigctl.values import Position

SILENCE_S = 2.0
"""A tracker that sends nothing for this time is lost; shorter dropouts are the estimator's."""


class StreamingTracker(ABC):
    """A tracker that delivers positions in the loop's thread until it is closed or lost."""

    def __init__(self, name: str, loop: asyncio.AbstractEventLoop) -> None:
        self.name = name
        self.counters = TrackerCounters()
        self._loop = loop
        self._watch = SilenceWatch(loop, SILENCE_S, self._fall_silent)
        self._on_position: OnPosition | None = None
        self._on_lost: OnTrackerLost | None = None

    @property
    def is_open(self) -> bool:
        """True from a successful open until closed or lost."""
        return self._on_position is not None

    def open(self, on_position: OnPosition, on_lost: OnTrackerLost) -> None:
        """Start to deliver positions. Raises LinkLost or RigFault where there is no source."""
        if self.is_open:
            raise LinkLost(f"{self.name}: the tracker is open already")
        self._on_position, self._on_lost = on_position, on_lost
        try:
            self._begin()
        except BaseException:
            self.close()
            raise
        self._watch.start()

    def close(self) -> None:
        """Stop; closing twice is harmless."""
        self._watch.stop()
        self._on_position = self._on_lost = None
        self._end()

    @abstractmethod
    def _begin(self) -> None:
        """Open the source."""

    @abstractmethod
    def _end(self) -> None:
        """Close the source; it may be closed already."""

    def _deliver(self, position: Position) -> None:
        """Hand on a position; a consumer that raises ends the stream, with its reason."""
        if self._on_position is None:
            return
        self._watch.heard_s = self._loop.time()
        self.counters.positions += 1
        self.counters.invalid += not position.valid
        try:
            self._on_position(position)
        except Exception as error:  # noqa: BLE001 - becomes a visible loss
            self._lose(f"{self.name}: a consumer of positions failed: {error!r}")

    def _lose(self, reason: str) -> None:
        on_lost = self._on_lost
        self.close()
        if on_lost is not None:
            on_lost(reason)

    def _fall_silent(self) -> None:
        self._lose(
            f"{self.name}: the tracker sent no position for {SILENCE_S:g} s: check that it is on "
            "and sends what docs/reference/trackers.md describes"
        )
