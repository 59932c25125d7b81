"""An engine without a rig: it follows a session that another program records.

A window is its client as of any engine, so that the same views show the session while it grows.
It reads the folder alone, from any computer that can, and refuses every command to the rig.
"""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

from rigctl.acquisition.follow.recorder_watch import RecorderWatch
from rigctl.acquisition.follow.states import RECORDER_GONE
from rigctl.acquisition.live_file import LiveFileWriter
from rigctl.acquisition.rpc.declared_commands import A_CLIENT, Result
from rigctl.acquisition.rpc.messages import EngineStatus, as_dict
from rigctl.acquisition.served_engine import ServedEngine
from rigctl.errors import WrongUse
from rigctl.values import Event

REFRESH_S = 0.25
"""As often as the recorder flushes."""
SHOWN_PAST_EVENTS = 200


class FollowedSession(Protocol):
    """A session of either experiment that grows, with live data and a status made of it."""

    @property
    def path(self) -> Path:
        """The session's folder."""

    @property
    def newest_s(self) -> float:
        """Loop time of the recorder at the newest row, s."""

    @property
    def has_ended(self) -> bool:
        """Whether the session was closed in order, at the last look."""

    def refresh(self) -> None:
        """Update to what the recorder has flushed. Raises WrongUse, OSError."""

    def take(self, now_s: float) -> Iterator[list[Event]]:
        """Make live data of the new rows, and yield the new events; ``now_s``: of this process."""

    def status(self, now_s: float) -> Any:
        """Return the status message at the time of :meth:`take`; reads no file."""

    def close(self) -> None:
        """Close the files."""


class FollowEngine(ServedEngine[Any, Any]):
    """Follows one session."""

    def __init__(
        self, loop: asyncio.AbstractEventLoop, followed: FollowedSession, writer: LiveFileWriter
    ) -> None:
        super().__init__(loop, str(followed.path), writer)
        self._followed = followed
        self._refreshed_s = loop.time()
        self._failure = ""
        self._recorder = RecorderWatch(followed.path)
        self._told = ""

    def start(self, request: Any) -> Any:
        """Refuse a run."""
        raise WrongUse(refusal("start"))

    def status(self) -> Any:
        """Return the status message; a run whose recorder is gone has failed."""
        status = self._followed.status(self.loop.time() - REFRESH_S)
        if not self._recorder.gone:
            return status
        is_drum = isinstance(status, EngineStatus)
        words = {"state": None, "state_words": RECORDER_GONE} if is_drum else {}
        run = replace(status.run, state="failed", text=self._recorder.gone, prompt=None)
        return replace(status, run=run, **words)

    async def _connect(self) -> None:
        self._take(is_first=True)

    def _serve_boards(self) -> None:
        if self.loop.time() - self._refreshed_s < REFRESH_S:
            return
        self._refreshed_s = self.loop.time()
        try:
            self._followed.refresh()
            self._take()
        except (WrongUse, OSError) as error:
            self._publish_failure(str(error))
        else:
            self._failure = ""
            self._look_at_recorder()

    def _look_at_recorder(self) -> None:
        """Say once that the recorder is gone, or may be."""
        self._recorder.look(self._refreshed_s, has_ended=self._followed.has_ended)
        sentence = self._recorder.gone or self._recorder.silent
        if sentence and sentence != self._told:
            self._tell([Event(self._followed.newest_s, "lost", sentence)])
        self._told = sentence

    def _publish_failure(self, sentence: str) -> None:
        """Say once that the folder cannot be read; the next look tries again."""
        if not self._failure:
            text = f"the session cannot be read now: {sentence}"
            self._tell([Event(self._followed.newest_s, "lost", text, {})])
        self._failure = sentence

    def _take(self, is_first: bool = False) -> None:
        for events in self._followed.take(self.loop.time()):
            if is_first:
                self._remember(events[-SHOWN_PAST_EVENTS:])
            else:
                self._tell(events)

    def _tell(self, events: list[Event]) -> None:
        """Send events with the times of the recorder, which the rows of the live file have."""
        self._remember(events)
        for event in events:
            self._broadcast(event)

    def _remember(self, events: list[Event]) -> None:
        """Keep events of before, as old as the newest rows say."""
        ahead_s = self.loop.time() - self._followed.newest_s
        for event in events:
            self._history.add(Event(event.at_s + ahead_s, event.kind, event.text))

    async def _make_safe(self) -> None:
        """Do nothing: there is no rig."""

    def _disconnect(self) -> None:
        self._followed.close()


class FollowCommands:
    """Executes requests to a follower: it tells its status, and refuses what a rig would do."""

    def __init__(self, engine: FollowEngine) -> None:
        self._engine = engine

    async def handle(self, command: str, args: dict[str, Any], by: str = A_CLIENT) -> Result:
        """Return the status, or end. Raises WrongUse for every other command."""
        if args or command not in ("status", "shutdown"):
            raise WrongUse(refusal(command))
        if command == "shutdown":
            self._engine.shut_down(f"{by} ended the follower")
            return {}
        return as_dict(self._engine.status())


def refusal(command: str) -> str:
    """Return why a follower does nothing to a rig."""
    if command == "stop":
        return (
            "STOP does not reach the rig from a window that only follows a session: press the "
            "rig's emergency stop, or STOP in a window on the rig's computer"
        )
    return (
        "this window only follows a session and cannot act on its rig: use a window on the rig's "
        "computer, or join its engine through SSH"
    )
