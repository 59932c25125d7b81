"""The engine of the moving finger: board, tracker, recorder and run in one event loop."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rigctl.engine.health import age_s
from rigctl.engine.rpc.messages import LINK, BoardStatus, RecordingStatus
from rigctl.engine.served_engine import ServedEngine
from rigctl.errors import RigFault
from rigctl.finger.devices import BOARD, TRACKER, FingerDevices
from rigctl.finger.latency import LatencyLog
from rigctl.finger.layout import FINGER_TRUTH
from rigctl.finger.live_file import FingerLiveWriter
from rigctl.finger.rig import FingerRig
from rigctl.finger.run import FingerRun
from rigctl.finger.run_request import FingerRunRequest, open_finger_run
from rigctl.finger.status import FingerEngineStatus, FingerRunStatus
from rigctl.session.ground_truth import TruthRecorder


class FingerEngine(ServedEngine[FingerRun, FingerRunRequest]):
    """The control program of one rig of the moving finger."""

    def __init__(
        self, rig: FingerRig, live_writer: FingerLiveWriter, utc_now: Callable[[], str]
    ) -> None:
        truth = TruthRecorder(lambda: rig.truth, FINGER_TRUTH)
        super().__init__(rig.loop, rig.description, truth, rig.config)
        self.rig = rig
        self.latencies = LatencyLog()
        self.devices = FingerDevices(
            rig, live_writer, self.event_bus, self.spawn, self._link_changed, self._fail_run
        )
        self._utc_now = utc_now

    def start(self, request: FingerRunRequest) -> FingerRun:
        """Start a run. Raises where the request or the disk is at fault."""
        board = self.devices.identity
        if board is None:
            raise RigFault("the finger board is not connected: plug it in, then start again")
        opened = open_finger_run(request, self.rig, board, self._utc_now())
        run = FingerRun(self.rig, self.devices, self.event_bus, opened, self.latencies)
        for device, connected in self.devices.connected.items():
            if not connected:
                run.control.pause(_reason(device))
        return self._begin(run)

    def _describe(self) -> dict[str, Any]:
        return {**super()._describe(), "world": self.rig.world}

    def status(self) -> FingerEngineStatus:
        """Return the status message."""
        now_s, devices, rig = self._now_s(), self.devices, self.rig
        recording, run = RecordingStatus(), FingerRunStatus()
        if self.run is not None:
            recording = self.run.recording_status(self.run.is_recording)
            run = self.run.status()
        position, board = devices.estimator.latest, devices.board_status
        return FingerEngineStatus(
            at_s=now_s,
            rig=rig.description,
            simulated=rig.simulated,
            finger_connected=devices.connected[BOARD],
            tracker_connected=devices.connected[TRACKER],
            tracker=rig.tracker.name,
            sample_rate_hz=devices.samples.per_s,
            lost_samples=devices.lost_samples,
            lost_age_s=age_s(devices.lost_s, now_s),
            damaged_frames=rig.finger.counters.damaged_frames,
            block_age_s=age_s(devices.block_s, now_s),
            position_age_s=age_s(devices.position_s, now_s),
            position_valid=position is not None and position.valid,
            along_mm=position.along_mm if position else 0.0,
            across_mm=position.across_mm if position else 0.0,
            height_mm=position.height_mm if position else 0.0,
            in_contact=devices.contact.touches,
            late_velocities=board.late_velocities if board else 0,
            dropouts=devices.estimator.counters.dropouts,
            outliers=devices.estimator.path_counters.outliers,
            latency_p99_ms=self.latencies.percentiles(99.0),
            board=self._board_status(),
            recording=recording,
            run=run,
            lsl=self.lsl.scope,
        )

    def _board_status(self) -> BoardStatus:
        identity = self.devices.identity
        if identity is None:
            return BoardStatus()
        return BoardStatus(firmware=identity.firmware_version, boot_count=identity.boot_count)

    def _is_recorded(self, run: FingerRun) -> bool:
        return run.is_recording and run.disk_monitor.grows

    def _link_changed(self, device: str, connected: bool) -> None:
        self._mark_link(_reason(device), connected)

    async def _connect(self) -> None:
        await self.devices.connect()

    async def _make_safe(self) -> None:
        """Do nothing: the finger board moves nothing."""

    def _disconnect(self) -> None:
        self.rig.finger.close()
        self.rig.tracker.close()
        super()._disconnect()


def _reason(device: str) -> str:
    return LINK if device == BOARD else device
