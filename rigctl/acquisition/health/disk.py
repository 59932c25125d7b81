"""Recording rate and remaining disk time, from the samples that reached the disk."""

from __future__ import annotations

from collections import deque

from rigctl.acquisition.rpc.messages import RecordingStatus
from rigctl.session.write.recorder import Recorder
from rigctl.session.write.writer import RecorderStatus

ACTIVE_WINDOW_S = 1.0
RATE_WINDOW_S = 30.0
RESERVE_S = 120.0
RESERVE_BYTES = 64 << 20
HUNG_SAMPLES = 60_000
"""A recorder whose queue holds a minute of samples counts as hung."""


class DiskMonitor:
    """Follows one recorder. Times are loop time; call :meth:`update` about ten times a second."""

    def __init__(self, recorder: Recorder) -> None:
        self._recorder = recorder
        self._history: deque[tuple[float, RecorderStatus]] = deque()

    def update(self, now_s: float) -> None:
        """Read the recorder's status."""
        self._history.append((now_s, self._recorder.status))
        while now_s - self._history[0][0] > RATE_WINDOW_S:
            self._history.popleft()

    @property
    def recorder_works(self) -> bool:
        """Whether the recorder keeps up or has reported a failure."""
        status = self._newest()
        return status.failure is not None or status.queue_samples < HUNG_SAMPLES

    def must_pause(self, paused: bool) -> bool:
        """Return whether the disk is too full to record; a ``paused`` run needs twice the room."""
        reserve = (RESERVE_BYTES + RESERVE_S * self._bytes_per_s()) * (2 if paused else 1)
        return bool(self._history) and self._newest().disk_free_bytes < reserve

    def status(self, recording: bool) -> RecordingStatus:
        """Return the recording's part of the status message."""
        newest = self._newest()
        last_s = newest.samples_on_disk - self._samples_before(ACTIVE_WINDOW_S)
        rate = self._bytes_per_s()
        return RecordingStatus(
            active=recording and last_s > 0,
            samples_on_disk=newest.samples_on_disk,
            samples_last_s=last_s,
            folder=str(self._recorder.folder),
            disk_free_bytes=newest.disk_free_bytes,
            hours_left=newest.disk_free_bytes / rate / 3600 if rate > 0 else None,
            failure=newest.failure,
        )

    def _newest(self) -> RecorderStatus:
        return self._history[-1][1] if self._history else self._recorder.status

    def _samples_before(self, seconds: float) -> int:
        for at_s, status in reversed(self._history):
            if self._history[-1][0] - at_s >= seconds:
                return status.samples_on_disk
        return self._history[0][1].samples_on_disk if self._history else 0

    def _bytes_per_s(self) -> float:
        if len(self._history) < 2:
            return 0.0
        (first_s, first), (last_s, last) = self._history[0], self._history[-1]
        return max(0.0, (last.bytes_on_disk - first.bytes_on_disk) / max(last_s - first_s, 1e-3))
