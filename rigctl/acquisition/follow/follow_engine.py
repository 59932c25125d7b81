"""An engine without a rig: it follows a session that another program records.

A window is its client as of any engine, so that the same views show the session while it grows.
It reads the folder alone, from any computer that can, and refuses every command to the rig.
"""

from __future__ import annotations

import asyncio
from typing import Any

from rigctl.acquisition.follow.followed_live import FollowedLive
from rigctl.acquisition.follow.followed_status import FollowedStatus
from rigctl.acquisition.follow.growing_session import GrowingSession
from rigctl.acquisition.live_buffer import LiveWriter
from rigctl.acquisition.rpc.messages import EngineStatus, as_dict
from rigctl.acquisition.served_engine import ServedEngine
from rigctl.errors import SessionError, WrongUse
from rigctl.values import Event

REFRESH_S = 0.25
"""As often as the recorder flushes."""
SHOWN_PAST_EVENTS = 200


class FollowEngine(ServedEngine[Any, Any]):
    """Follows one session; raises SessionError where it cannot be opened."""

    def __init__(
        self, loop: asyncio.AbstractEventLoop, growing: GrowingSession, writer: LiveWriter
    ) -> None:
        super().__init__(loop, str(growing.session.path), writer)
        self._growing = growing
        self._live = FollowedLive(writer, growing.session.header)
        self._status = FollowedStatus(growing.session)
        self._refreshed_s = loop.time()
        self._failure = ""

    def start(self, request: Any) -> Any:
        """Refuse a run."""
        raise WrongUse(refusal("start"))

    def status(self) -> EngineStatus:
        """Return the status message."""
        return self._status.build(self.loop.time() - REFRESH_S)

    async def _connect(self) -> None:
        self._take(is_first=True)

    def _serve_boards(self) -> None:
        if self.loop.time() - self._refreshed_s < REFRESH_S:
            return
        self._refreshed_s = self.loop.time()
        try:
            self._growing.refresh()
            self._take()
        except (SessionError, OSError) as error:
            self._publish_failure(str(error))
        else:
            self._failure = ""

    def _publish_failure(self, sentence: str) -> None:
        """Say once that the folder cannot be read; the next look tries again."""
        if not self._failure:
            self.event_bus.publish("lost", f"the session cannot be read now: {sentence}")
        self._failure = sentence

    def _take(self, is_first: bool = False) -> None:
        for rows in self._growing.take_rows():
            for block in rows.blocks:
                self._live.add_block(block)
            self._live.add_drum(rows.polls, rows.loadcell)
            self._status.update(rows, self.loop.time())
            if is_first:
                self._remember(rows.events[-SHOWN_PAST_EVENTS:])
            else:
                self._tell(rows.events)

    def _tell(self, events: list[Event]) -> None:
        for event in events:
            self.event_bus.publish(event.kind, event.text, **event.data)

    def _remember(self, events: list[Event]) -> None:
        """Keep events of before, as old as the newest rows say."""
        ahead_s = self.loop.time() - self._status.newest_s
        for event in events:
            self._history.add(Event(event.at_s + ahead_s, event.kind, event.text))

    async def _make_safe(self) -> None:
        """Do nothing: there is no rig."""

    def _disconnect(self) -> None:
        self._growing.close()


class FollowCommands:
    """Executes requests to a follower: it tells its status, and refuses what a rig would do."""

    def __init__(self, engine: FollowEngine) -> None:
        self._engine = engine

    async def handle(self, command: str, args: dict[str, Any]) -> dict[str, Any]:
        """Return the status, or end. Raises WrongUse for every other command."""
        if args or command not in ("status", "shutdown"):
            raise WrongUse(refusal(command))
        if command == "shutdown":
            self._engine.shut_down("a client ended the follower")
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
