"""A session of the moving finger that is followed: its rows, live data and status."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from rigctl.realtime.follow.followed_finger_status import FollowedFingerStatus
from rigctl.realtime.follow.followed_scans import FollowedScans
from rigctl.realtime.follow.growing_finger_session import GrowingFingerSession
from rigctl.realtime.live_file import FingerLiveWriter
from rigctl.realtime.messages import FingerEngineStatus
from rigctl.session.part import StructuredArray
from rigctl.values import Event


class FollowedFinger:
    """Makes live data, events and a status of a growing session."""

    def __init__(self, growing: GrowingFingerSession, writer: FingerLiveWriter) -> None:
        self._growing, self._writer = growing, writer
        self._scans = FollowedScans()
        self._status = FollowedFingerStatus(growing.session)
        self._part = 0

    @property
    def path(self) -> Path:
        """The session's folder."""
        return self._growing.session.path

    @property
    def newest_s(self) -> float:
        """Loop time of the recorder at the newest row, s."""
        return self._status.newest_s

    @property
    def has_ended(self) -> bool:
        """Whether the session was closed in order, at the last look."""
        return self._status.has_ended

    def refresh(self) -> None:
        """Update to what the recorder has flushed. Raises SessionError, OSError."""
        self._growing.refresh()

    def take(self, now_s: float) -> Iterator[list[Event]]:
        """Make live data of the new rows, and yield the new events, batches and answers too."""
        for rows in self._growing.take_rows():
            if rows.part != self._part:
                self._part = rows.part
                self._writer.set_range(rows.ranges.low, rows.ranges.high)
            for block, arrived_s in rows.blocks:
                self._writer.add_block(block, arrived_s)
            self._add_track(rows.track)
            events = self._scans.events(rows)
            self._status.velocity_mm_s = self._scans.velocity_mm_s
            self._status.update(rows, now_s)
            yield events

    def status(self, now_s: float) -> FingerEngineStatus:
        """Return the status message at the time of :meth:`take`."""
        return self._status.build(now_s)

    def close(self) -> None:
        """Close the files."""
        self._growing.close()

    def _add_track(self, track: StructuredArray) -> None:
        names = ("along_mm", "across_mm", "height_mm")
        known = track["valid"].astype(bool) & np.all([np.isfinite(track[n]) for n in names], axis=0)
        places = {name: np.ascontiguousarray(track[name]) for name in names}
        self._writer.add_track(np.ascontiguousarray(track["at_s"]), valid=known, **places)
