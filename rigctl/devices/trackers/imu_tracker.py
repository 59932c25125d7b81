"""An accelerometer and gyroscope as a tracker: for slides between rests at the marks."""

from __future__ import annotations

import asyncio

from rigctl.devices.links.byte_link import ByteLink
from rigctl.devices.trackers.imu_integrator import ImuIntegrator
from rigctl.devices.trackers.source_clock import SourceClock
from rigctl.devices.trackers.streaming_tracker import StreamingTracker
from rigctl.wire.tracker_lines import ImuLines


class ImuTracker(StreamingTracker):
    """Positions integrated from lines of ``time_ms,ax,ay,az,gx,gy,gz``, x along the plate.

    ``integrator.drifts`` holds the error of each movement.
    """

    def __init__(
        self, link: ByteLink, loop: asyncio.AbstractEventLoop, latency_s: float = 0.0
    ) -> None:
        super().__init__(f"imu {link.name}", loop)
        self._link = link
        self._latency_s = latency_s
        self._restart()

    def _restart(self) -> None:
        self.integrator = ImuIntegrator()
        self._lines = ImuLines()
        self._clock = SourceClock(self._latency_s)

    def _begin(self) -> None:
        self._restart()
        self._link.open(self._receive, self._lose)

    def _end(self) -> None:
        self._link.close()

    def _receive(self, data: bytes, arrived_s: float) -> None:
        malformed, restarts = self._lines.malformed, self._clock.restarts
        for time_ms, acceleration, turn in self._lines.feed(data):
            at_s = self._clock.loop_s(time_ms / 1000.0, arrived_s)
            if at_s is None:
                self.counters.out_of_order += 1
            else:
                self._deliver(self.integrator.add(at_s, acceleration, turn))
        self.counters.malformed += self._lines.malformed - malformed
        self.counters.clock_restarts += self._clock.restarts - restarts
