"""What a follower tells of every growing session: samples, trials, losses, run, and their ages."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rigctl.acquisition.follow.followed_run import FollowedRun
from rigctl.acquisition.health.rate_meter import RateMeter, age_s
from rigctl.acquisition.rpc.messages import RecordingStatus
from rigctl.session.session_reader import SessionReader
from rigctl.session.writer_lock import is_being_written
from rigctl.values import Event, Verdict

RATE_WINDOW_S = 1.0
QUIET_S = 3.0
"""Without new rows for this long the recorder is said to write nothing."""


class FollowedGrowth:
    """Counts what came at each look, so that a status needs no file. Ages count from that look."""

    def __init__(self, session: SessionReader) -> None:
        self._session = session
        self._rate = RateMeter(RATE_WINDOW_S)
        self._samples = 0
        self._sampled_s: float | None = None
        self._part = 0
        self._lost_s: float | None = None
        self.run = FollowedRun()
        self.newest_s = 0.0
        """Loop time of the recorder at the newest row, s."""
        self._count()

    def update(self, part: int, samples: int, events: Sequence[Event], now_s: float) -> None:
        """Take note of new rows of one part that were read at ``now_s``."""
        self._samples += samples
        self._rate.update(now_s, self._samples)
        if samples:
            self._sampled_s = now_s
        if part != self._part:
            self._part = part
            self.run.begin_part()
        self.run.update(events)
        for event in events:
            self.see(event.at_s)
        lost_before = self.lost_samples
        self._count()
        if self.lost_samples > lost_before:
            self._lost_s = now_s

    def see(self, at_s: float) -> None:
        """Take the loop time of a new row."""
        self.newest_s = max(self.newest_s, at_s)

    @property
    def rate_hz(self) -> float:
        """Samples of the last second."""
        return self._rate.per_s

    @property
    def state(self) -> str:
        """The state of the run."""
        return self.run.state(has_ended=self.has_ended)

    def sample_age_s(self, now_s: float) -> float | None:
        """Return the time since new samples came, None before any."""
        return age_s(self._sampled_s, now_s)

    def lost_age_s(self, now_s: float) -> float | None:
        """Return the time since the look that found the last losses, None before any."""
        return age_s(self._lost_s, now_s)

    def is_growing(self, rows_age_s: float | None) -> bool:
        """Return whether rows of this age say that the recorder writes."""
        return not self.has_ended and rows_age_s is not None and rows_age_s < QUIET_S

    def recording(self, now_s: float) -> RecordingStatus:
        """Return what has reached the disk."""
        grows = self.is_growing(self.sample_age_s(now_s))
        return RecordingStatus(
            active=grows,
            samples_on_disk=self.samples_on_disk,
            samples_last_s=round(self._rate.per_s) if grows else 0,
            folder=str(self._session.path),
        )

    def _count(self) -> None:
        session = self._session
        self.has_ended = session.finished and not self._goes_on()
        self.samples_on_disk = session.n_samples
        gaps = session.gaps
        self.gaps, self.lost_samples = len(gaps), int(gaps["count"].sum())
        self.trials_committed = len(session.committed())
        self.trials_rejected = int(np.sum(session.trials["verdict"] == Verdict.REJECTED.value))

    def _goes_on(self) -> bool:
        """Return whether the last part is closed because its recorder begins the next one."""
        return not self.run.has_ended and is_being_written(self._session.path)
