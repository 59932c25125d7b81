"""A tracker that sends lines of ``time_ms,x,y,z`` over a byte link."""

from __future__ import annotations

import asyncio

from rigctl.devices.links.byte_link import ByteLink
from rigctl.devices.trackers.source_clock import SourceClock
from rigctl.devices.trackers.streaming_tracker import StreamingTracker
from rigctl.values import Position
from rigctl.wire.tracker_lines import PositionLines


class SerialTracker(StreamingTracker):
    """Positions in mm from a serial port; ``latency_s`` from measurement to earliest arrival."""

    def __init__(
        self, link: ByteLink, loop: asyncio.AbstractEventLoop, latency_s: float = 0.0
    ) -> None:
        super().__init__(f"tracker {link.name}", loop)
        self._link = link
        self._latency_s = latency_s
        self._lines = PositionLines(joins=True)
        self._clock = SourceClock(latency_s)

    def _begin(self) -> None:
        self._lines = PositionLines(joins=True)
        self._clock = SourceClock(self._latency_s)
        self._link.open(self._receive, self._lose)

    def _end(self) -> None:
        self._link.close()

    def _receive(self, data: bytes, arrived_s: float) -> None:
        malformed, restarts = self._lines.malformed, self._clock.restarts
        for time_ms, x, y, z, valid in self._lines.feed(data):
            at_s = self._clock.loop_s(time_ms / 1000.0, arrived_s)
            if at_s is None:
                self.counters.out_of_order += 1
            else:
                self._deliver(Position(at_s, x, y, z, valid))
        self.counters.malformed += self._lines.malformed - malformed
        self.counters.clock_restarts += self._clock.restarts - restarts
