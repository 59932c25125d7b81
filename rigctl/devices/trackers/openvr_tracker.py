"""A VIVE tracker through SteamVR: a thread polls its pose (extra ``vive``)."""

from __future__ import annotations

import asyncio
import threading
from contextlib import suppress
from typing import Any

from rigctl.devices.trackers.streaming_tracker import StreamingTracker
from rigctl.errors import LinkLost, RigFault
from rigctl.values import Position

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
