"""Whether samples reach the disk, and for how long they still can: from what really got there."""

from __future__ import annotations

from collections import deque

from rigctl.acquisition.rpc.messages import RecordingStatus
from rigctl.session.write.recorder import Recorder, RecorderStatus

TRUTH_WINDOW_S = 1.0
RATE_WINDOW_S = 30.0
RESERVE_S = 120.0
RESERVE_BYTES = 64 << 20
HUNG_SAMPLES = 60_000
"""A recorder with a minute of samples before it does not work any more."""


class DiskMonitor:
    """Follows one recorder. Times are loop time; call :meth:`look` about ten times a second."""

    def __init__(self, recorder: Recorder) -> None:
        self._recorder = recorder
        self._seen: deque[tuple[float, RecorderStatus]] = deque()

    def look(self, now_s: float) -> None:
        """Take note of what is on disk now."""
        self._seen.append((now_s, self._recorder.status))
        while now_s - self._seen[0][0] > RATE_WINDOW_S:
            self._seen.popleft()

    @property
    def works(self) -> bool:
        """Whether the recorder kept up at the last look, or has said why not."""
        status = self._seen[-1][1] if self._seen else self._recorder.status
        return status.failure is not None or status.queue_samples < HUNG_SAMPLES

    def must_hold(self, held: bool) -> bool:
        """Whether the disk is so full that a run has to wait; ``held``: it waits already."""
        reserve = self._reserve_bytes() * (2 if held else 1)
        newest = self._seen[-1][1] if self._seen else None
        return newest is not None and newest.disk_free_bytes < reserve

    def status(self, recording: bool) -> RecordingStatus:
        """The truth about the disk."""
        newest = self._seen[-1][1] if self._seen else self._recorder.status
        fresh = newest.samples_on_disk - self._samples_before(TRUTH_WINDOW_S)
        rate = self._bytes_per_s()
        return RecordingStatus(
            active=recording and fresh > 0,
            samples_on_disk=newest.samples_on_disk,
            samples_last_s=fresh,
            folder=str(self._recorder.folder),
            disk_free_bytes=newest.disk_free_bytes,
            hours_left=newest.disk_free_bytes / rate / 3600 if rate > 0 else None,
            failure=newest.failure,
        )

    def _samples_before(self, seconds: float) -> int:
        for at_s, status in reversed(self._seen):
            if self._seen[-1][0] - at_s >= seconds:
                return status.samples_on_disk
        return self._seen[0][1].samples_on_disk if self._seen else 0

    def _bytes_per_s(self) -> float:
        if len(self._seen) < 2:
            return 0.0
        (first_s, first), (last_s, last) = self._seen[0], self._seen[-1]
        return max(0.0, (last.bytes_on_disk - first.bytes_on_disk) / max(last_s - first_s, 1e-3))

    def _reserve_bytes(self) -> float:
        return RESERVE_BYTES + RESERVE_S * self._bytes_per_s()
