"""A session that is followed before it has a first part: its run asks for its first plate."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from rigctl.acquisition.follow.follow_engine import FollowedSession
from rigctl.acquisition.follow.states import NOTHING_YET
from rigctl.config.text_file import is_plain_file
from rigctl.protocol.finger_plan import is_finger_protocol
from rigctl.session.finger_session import is_finger_session
from rigctl.session.layout import LOCK_FILE, PROTOCOL_FILE
from rigctl.session.session_reader import highest_number
from rigctl.values import Event


class AwaitedSession:
    """Waits for a session's first part, then is the session.

    ``open_session``: opens it. ``waiting``: the status until then.
    """

    def __init__(
        self, path: Path, open_session: Callable[[], FollowedSession], waiting: Any
    ) -> None:
        self._path = path
        self._open_session = open_session
        self._waiting = waiting
        self._session: FollowedSession | None = None
        self._is_told = False

    @property
    def path(self) -> Path:
        """The session's folder."""
        return self._path

    @property
    def newest_s(self) -> float:
        """Loop time of the recorder at the newest row, s; 0 before any."""
        return 0.0 if self._session is None else self._session.newest_s

    @property
    def has_ended(self) -> bool:
        """Whether the session was closed in order, at the last look."""
        return self._session is not None and self._session.has_ended

    def refresh(self) -> None:
        """Open the session once it has a part, then update it. Raises WrongUse, OSError."""
        if self._session is not None:
            self._session.refresh()
        elif not is_awaited(self._path):
            self._session = self._open_session()

    def take(self, now_s: float) -> Iterator[list[Event]]:
        """Make live data of the new rows, and yield the new events; at first that none are."""
        if self._session is not None:
            yield from self._session.take(now_s)
        elif not self._is_told:
            self._is_told = True
            yield [Event(0.0, "log", NOTHING_YET)]

    def status(self, now_s: float) -> Any:
        """Return the status message at the time of :meth:`take`."""
        return self._waiting if self._session is None else self._session.status(now_s)

    def close(self) -> None:
        """Close the files."""
        if self._session is not None:
            self._session.close()


def is_awaited(folder: Path) -> bool:
    """Return whether a recorder has prepared a folder, and no part was ever begun in it."""
    prepared = all(is_plain_file(folder / name) for name in (LOCK_FILE, PROTOCOL_FILE))
    return prepared and not highest_number(folder)


def follows_finger(folder: Path) -> bool:
    """Return whether a session, begun or awaited, is of the moving finger. Raises WrongUse."""
    if is_awaited(folder):
        return is_finger_protocol(folder / PROTOCOL_FILE)
    return is_finger_session(folder)
