"""Trackers that stream positions: over a serial line, UDP or OpenVR, in one clock."""

from __future__ import annotations

import asyncio
import socket
import threading
from abc import ABC, abstractmethod
from contextlib import suppress
from typing import Any

from rigctl.boards.boot_silence import SilenceWatch
from rigctl.boards.clock_fit import ClockFit
from rigctl.boards.links import ByteLink
from rigctl.errors import LinkLost, RigFault
from rigctl.finger.trackers.lines import PositionLines, decode_datagram
from rigctl.finger.trackers.tracker import OnPosition, OnTrackerLost, TrackerCounters
from rigctl.values import Position

TRUSTED_PPM = 200.0
"""Until the rate of the source's clock is known this well, it counts as exact."""
RESTART_S = 1.0
"""A source whose time leaps by more than this has begun its clock again."""


class SourceClock:
    """Maps ascending source times to loop times.

    No message arrives early, so the earliest arrivals tell the offset of the clocks; the known
    ``latency_s`` is subtracted. ``restarts`` counts how often the source's time began anew. Loop
    times ascend, also where an earlier arrival shows that those before were told too late.
    """

    def __init__(self, latency_s: float) -> None:
        self.restarts = 0
        self._latency_s = latency_s
        self._fit = ClockFit()
        self._last: tuple[float, float] | None = None
        self._earliest_s = float("inf")
        self._told_s = float("-inf")

    def loop_s(self, source_s: float, arrived_s: float) -> float | None:
        """Return the loop time of a measurement; None where its time does not ascend."""
        if self._last is not None:
            passed_s = source_s - self._last[0]
            if not -RESTART_S < passed_s < arrived_s - self._last[1] + RESTART_S:
                self._restart()
            elif passed_s <= 0.0:
                return None
        self._last = (source_s, arrived_s)
        at_s = self._fitted_s(source_s, arrived_s)
        if at_s <= self._told_s:
            return None
        self._told_s = at_s
        return at_s

    def _fitted_s(self, source_s: float, arrived_s: float) -> float:
        self._fit.add(source_s, arrived_s)
        self._earliest_s = min(self._earliest_s, arrived_s - source_s)
        estimate = self._fit.estimate
        line = self._fit.earliest_arrivals
        if estimate is None or line is None or estimate.error_ppm > TRUSTED_PPM:
            return source_s + self._earliest_s - self._latency_s
        return min(line.loop_s(source_s), arrived_s) - self._latency_s

    def _restart(self) -> None:
        self.restarts += 1
        self._fit.reset()
        self._earliest_s = float("inf")


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


LOOPBACK = "127.0.0.1"
READ_SIZE = 2048
AT_ONCE = 64
"""Datagrams read in a row: a flood cannot keep the loop from its other work."""


class UdpTracker(StreamingTracker):
    """Positions in mm from datagrams to a port of this computer.

    It listens on loopback and takes datagrams of ``sender`` only; others are counted as foreign.
    To listen to another computer, ``host`` is this computer's address and ``sender`` the other's.
    Port 0 takes a free one: see ``port`` after opening. Needs a selector loop.
    """

    def __init__(
        self,
        port: int,
        loop: asyncio.AbstractEventLoop,
        latency_s: float = 0.0,
        host: str = LOOPBACK,
        sender: str = LOOPBACK,
    ) -> None:
        super().__init__(f"tracker udp:{port}", loop)
        self.port = port
        self._address = (host, port)
        self._sender = sender
        self._latency_s = latency_s
        self._socket: socket.socket | None = None
        self._clock = SourceClock(latency_s)
        self._last_sequence: int | None = None

    def _begin(self) -> None:
        self._clock, self._last_sequence = SourceClock(self._latency_s), None
        listening = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            listening.setblocking(False)
            listening.bind(self._address)
        except OSError as error:
            listening.close()
            raise LinkLost(
                f"{self.name}: cannot listen on {self._address[0]}: close the program that holds "
                f"the port, or choose another ({error.strerror})"
            ) from error
        self.port = listening.getsockname()[1]
        self._socket = listening
        self._loop.add_reader(listening, self._receive)

    def _end(self) -> None:
        if self._socket is not None:
            self._loop.remove_reader(self._socket)
            self._socket.close()
            self._socket = None

    def _receive(self) -> None:
        for _ in range(AT_ONCE):
            if self._socket is None:
                return
            try:
                data, address = self._socket.recvfrom(READ_SIZE)
            except OSError:  # nothing is left, or a sender's port was unreachable
                return
            self.take(data, address[0], self._loop.time())

    def take(self, data: bytes, sender: str, arrived_s: float) -> None:
        """Take one datagram that arrived from an address at a loop time."""
        counters = self.counters
        if sender != self._sender:
            counters.foreign += 1
            return
        datagram = decode_datagram(data)
        if datagram is None:
            counters.malformed += 1
            return
        sequence, (time_ms, x, y, z, valid) = datagram
        restarts = self._clock.restarts
        at_s = self._clock.loop_s(time_ms / 1000.0, arrived_s)
        restarted = self._clock.restarts > restarts
        counters.clock_restarts += restarted
        last = None if restarted else self._last_sequence
        if at_s is None or (last is not None and sequence <= last):
            counters.out_of_order += 1
            return
        counters.lost += 0 if last is None else sequence - last - 1
        self._last_sequence = sequence
        self._deliver(Position(at_s, x, y, z, valid))


POLL_S = 0.004
"""SteamVR extrapolates the pose to the moment of the call, so its latency counts as 0."""
_MM_PER_M = 1000.0


class OpenVrTracker(StreamingTracker):
    """One VIVE tracker, the only one there or that with ``serial``.

    Poses are those of the raw universe, which nobody can re-centre during a session. A position
    is valid where SteamVR says that tracking runs and that the pose is valid; out of range, it
    goes on by dead reckoning and is not.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop, serial: str = "") -> None:
        super().__init__(f"vive {serial}".strip(), loop)
        self._serial = serial
        self._openvr: Any = None
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None

    def _begin(self) -> None:
        openvr = _import_openvr(self.name)
        try:
            system = openvr.init(openvr.VRApplication_Background)
        except openvr.OpenVRError as error:
            raise LinkLost(f"{self.name}: SteamVR does not run: start it ({error!r})") from error
        self._openvr = openvr
        index = self._find(openvr, system)
        self._stop = threading.Event()
        self._thread = threading.Thread(
            target=self._poll, args=(openvr, system, index, self._stop), name=self.name, daemon=True
        )
        self._thread.start()

    def _end(self) -> None:
        self._stop.set()
        thread, self._thread = self._thread, None
        if thread is not None:
            thread.join()
        openvr, self._openvr = self._openvr, None
        if openvr is not None:
            openvr.shutdown()

    def _find(self, openvr: Any, system: Any) -> int:
        """Return the index of the tracker. Raises LinkLost where it is not there or ambiguous."""
        serials = {
            system.getStringTrackedDeviceProperty(index, openvr.Prop_SerialNumber_String): index
            for index in range(openvr.k_unMaxTrackedDeviceCount)
            if system.getTrackedDeviceClass(index) == openvr.TrackedDeviceClass_GenericTracker
        }
        there = ", ".join(sorted(serials)) or "none"
        if self._serial and self._serial not in serials:
            raise LinkLost(f"{self.name}: SteamVR has not this one but {there}: switch it on")
        if not self._serial and len(serials) != 1:
            raise LinkLost(
                f"{self.name}: SteamVR must have one tracker, it has {there}: switch one on, or "
                "name it as vive:SERIAL"
            )
        return serials[self._serial] if self._serial else next(iter(serials.values()))

    def _poll(self, openvr: Any, system: Any, index: int, stop: threading.Event) -> None:
        """Hand poses to the loop until ``stop`` is set or SteamVR goes; runs in a thread."""
        poses = (openvr.TrackedDevicePose_t * openvr.k_unMaxTrackedDeviceCount)()
        event = openvr.VREvent_t()
        universe = openvr.TrackingUniverseRawAndUncalibrated
        try:
            while not stop.wait(POLL_S):
                system.getDeviceToAbsoluteTrackingPose(universe, 0.0, poses)
                position = _position(openvr, poses[index], self._loop.time())
                self._loop.call_soon_threadsafe(self._take, stop, position)
                while system.pollNextEvent(event):
                    if event.eventType == openvr.VREvent_Quit:
                        system.acknowledgeQuit_Exiting()
                        raise openvr.OpenVRError("SteamVR was closed")
        except openvr.OpenVRError as error:
            with suppress(RuntimeError):
                self._loop.call_soon_threadsafe(self._lose_system, stop, str(error))
        except RuntimeError:
            # The loop is closed.
            stop.set()

    def _take(self, stop: threading.Event, position: Position) -> None:
        if not stop.is_set():
            self._deliver(position)

    def _lose_system(self, stop: threading.Event, reason: str) -> None:
        if not stop.is_set():
            self._lose(f"{self.name}: the tracker is gone: start SteamVR again ({reason})")


def _import_openvr(name: str) -> Any:
    try:
        import openvr
    except ImportError as error:
        raise RigFault(
            f"{name}: the package openvr is not installed: pip install 'rigctl[vive]'"
        ) from error
    return openvr


def _position(openvr: Any, pose: Any, at_s: float) -> Position:
    """Return a pose as a position: the last column of its matrix, which is in metres."""
    x, y, z = (float(row[3]) * _MM_PER_M for row in pose.mDeviceToAbsoluteTracking.m)
    running = pose.eTrackingResult == openvr.TrackingResult_Running_OK
    return Position(at_s, x, y, z, bool(pose.bDeviceIsConnected and pose.bPoseIsValid and running))
