"""A stand-in for the package openvr: the part of its interface that the tracker uses."""

from __future__ import annotations

import ctypes
import types
from collections import deque

MATRIX = ctypes.c_float * 4 * 3


class HmdMatrix34(ctypes.Structure):
    _fields_ = (("m", MATRIX),)


class TrackedDevicePose(ctypes.Structure):
    _fields_ = (
        ("mDeviceToAbsoluteTracking", HmdMatrix34),
        ("eTrackingResult", ctypes.c_int),
        ("bPoseIsValid", ctypes.c_bool),
        ("bDeviceIsConnected", ctypes.c_bool),
    )


class VREvent(ctypes.Structure):
    _fields_ = (("eventType", ctypes.c_uint32),)


class OpenVRError(Exception):
    pass


class SteamVR(types.ModuleType):
    """SteamVR with a base station at index 1 and trackers at 3, 4, …; poses move 1 mm a poll."""

    OpenVRError = OpenVRError
    TrackedDevicePose_t = TrackedDevicePose
    VREvent_t = VREvent
    VREvent_Quit = 700
    VRApplication_Background = 3
    TrackingUniverseRawAndUncalibrated = 2
    TrackedDeviceClass_GenericTracker = 3
    TrackingResult_Running_OK = 200
    TrackingResult_Running_OutOfRange = 201
    Prop_SerialNumber_String = 1002
    k_unMaxTrackedDeviceCount = 64  # noqa: N815 - the name in openvr

    def __init__(self, *serials: str) -> None:
        super().__init__("openvr")
        self.serials = dict(enumerate(serials, start=3))
        self.running = True
        self.sessions = 0
        self.quit_acknowledged = False
        self.tracking = self.TrackingResult_Running_OK
        self.connected = True
        self.events: deque[int] = deque()
        self._polls = 0

    def init(self, application: int) -> SteamVR:
        if not self.running:
            raise OpenVRError("Init_NoServerForBackgroundApp")
        assert application == self.VRApplication_Background
        self.sessions += 1
        return self

    def shutdown(self) -> None:
        self.sessions -= 1

    def getTrackedDeviceClass(self, index: int) -> int:
        return 3 if index in self.serials else 4 if index == 1 else 0

    def getStringTrackedDeviceProperty(self, index: int, what: int) -> str:
        assert what == self.Prop_SerialNumber_String
        return self.serials[index]

    def getDeviceToAbsoluteTrackingPose(
        self, universe: int, ahead_s: float, poses: ctypes.Array[TrackedDevicePose]
    ) -> None:
        assert (universe, ahead_s) == (self.TrackingUniverseRawAndUncalibrated, 0.0)
        if not self.running:
            raise OpenVRError("IPC_ConnectFailed")
        self._polls += 1
        for index in self.serials:
            pose = poses[index]
            row = pose.mDeviceToAbsoluteTracking.m
            row[0][3], row[1][3], row[2][3] = 0.001 * self._polls, 0.5, float(index)
            pose.eTrackingResult = self.tracking
            pose.bPoseIsValid = pose.bDeviceIsConnected = self.connected

    def pollNextEvent(self, event: VREvent) -> bool:
        if not self.events:
            return False
        event.eventType = self.events.popleft()
        return True

    def acknowledgeQuit_Exiting(self) -> None:
        self.quit_acknowledged = True
