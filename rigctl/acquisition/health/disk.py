"""Recording rate and remaining disk time, from the samples that reached the disk."""

from __future__ import annotations

from rigctl.acquisition.health.rate_meter import RateMeter
from rigctl.acquisition.rpc.messages import RecordingStatus
from rigctl.session.recorder import SessionRecorder

ACTIVE_WINDOW_S = 1.0
RATE_WINDOW_S = 30.0
RESERVE_S = 120.0
RESERVE_BYTES = 64 << 20
HUNG_SAMPLES = 60_000
"""A recorder whose queue holds a minute of samples counts as hung."""


class DiskMonitor:
    """Follows one recorder. Times are loop time; call :meth:`update` about ten times a second."""

    def __init__(self, recorder: SessionRecorder) -> None:
        self._recorder = recorder
        self._samples = RateMeter(ACTIVE_WINDOW_S)
        self._bytes = RateMeter(RATE_WINDOW_S)

    def update(self, now_s: float) -> None:
        """Read the recorder's status."""
        status = self._recorder.status
        self._samples.update(now_s, status.samples_on_disk)
        self._bytes.update(now_s, status.bytes_on_disk)

    @property
    def recorder_works(self) -> bool:
        """Whether the recorder keeps up or has reported a failure."""
        status = self._recorder.status
        return status.failure is not None or status.queue_samples < HUNG_SAMPLES

    def must_pause(self, paused: bool) -> bool:
        """Return whether the disk is too full to record; a ``paused`` run needs twice the space."""
        reserve = (RESERVE_BYTES + RESERVE_S * self._bytes.per_s) * (2 if paused else 1)
        return self._recorder.status.disk_free_bytes < reserve

    def status(self, recording: bool) -> RecordingStatus:
        """Return the recording's part of the status message."""
        status, rate = self._recorder.status, self._bytes.per_s
        return RecordingStatus(
            active=recording and self._samples.increase > 0,
            samples_on_disk=status.samples_on_disk,
            samples_last_s=self._samples.increase,
            folder=str(self._recorder.folder),
            disk_free_bytes=status.disk_free_bytes,
            hours_left=status.disk_free_bytes / rate / 3600 if rate > 0 else None,
            failure=status.failure,
        )
