"""A session of the drum that is followed: its rows, live data and status."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from rigctl.acquisition.follow.followed_live import FollowedLive
from rigctl.acquisition.follow.followed_status import FollowedStatus
from rigctl.acquisition.follow.growing_session import GrowingSession
from rigctl.acquisition.live_buffer import LiveWriter
from rigctl.acquisition.rpc.messages import EngineStatus
from rigctl.values import Event


class FollowedDrum:
    """Makes live data and a status of a growing session."""

    def __init__(self, growing: GrowingSession, writer: LiveWriter) -> None:
        self._growing = growing
        self._live = FollowedLive(writer, growing.session)
        self._status = FollowedStatus(growing.session)

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
        """Make live data of the new rows, and yield the new events."""
        for rows in self._growing.take_rows():
            for block in rows.blocks:
                self._live.add_block(block)
            self._live.add_drum(rows.polls, rows.loadcell)
            self._status.update(rows, now_s)
            yield rows.events

    def status(self, now_s: float) -> EngineStatus:
        """Return the status message at the time of :meth:`take`."""
        return self._status.build(now_s)

    def close(self) -> None:
        """Close the files."""
        self._growing.close()
