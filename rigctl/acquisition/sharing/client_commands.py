"""What one client asks about itself and the others; all other commands go to the engine.

Most of the engine's commands need control (:mod:`rigctl.acquisition.sharing.control`).
"""

from __future__ import annotations

from typing import Annotated, Any, Protocol

from msgspec import Meta

from rigctl.acquisition.rpc.arguments import ClientName, Number, read_arguments
from rigctl.acquisition.rpc.declared_commands import RequestHandler, Result, declared_methods
from rigctl.acquisition.rpc.queues.connected_client import ConnectedClient
from rigctl.acquisition.sharing.control import Control
from rigctl.acquisition.sharing.event_history import KEPT_EVENTS, PastEvent

FREE_COMMANDS = frozenset({"stop", "abort", "status", "shown"})
"""Commands of the engine that need no control: they look, or make the rig safe."""


class SharedEngine(Protocol):
    """An engine as one of its clients sees it."""

    @property
    def control(self) -> Control:
        """Who has control."""

    def past_events(self, count: int) -> list[tuple[float, PastEvent]]:
        """Return the newest events with their ages in s."""

    def end_if_unused(self, text: str) -> bool:
        """End the engine where it has one client and no run; return whether it ends."""


class ClientCommands:
    """Executes the requests of one client. ``handle`` executes those to the engine."""

    def __init__(
        self, client: ConnectedClient, engine: SharedEngine, handle: RequestHandler
    ) -> None:
        self._client = client
        self._number = client.number
        self._engine = engine
        self._handle = handle
        self._commands = declared_methods(type(self))

    async def handle(self, command: str, args: dict[str, Any]) -> Result:
        """Execute one request. Raises WrongUse for wrong arguments or without control."""
        own = self._commands.get(command)
        if own is not None:
            arguments = read_arguments(f"command {command}", own.arguments, args)
            return await own.execute(self, arguments) or {}
        if command not in FREE_COMMANDS:
            self._engine.control.require(self._number)
        return await self._handle(command, args, self._name)

    @property
    def _name(self) -> str:
        """The name that the client has told, when it joined or at the door."""
        number = self._number
        joined = self._engine.control.state.clients.get(number)
        return joined or self._client.name or f"client {number}"

    def close(self) -> None:
        """Take note that the client has left."""
        self._engine.control.leave(self._number)

    async def on_introduce(self, name: ClientName) -> Result:
        """Tell the other clients a name; return the client's number, and who has control."""
        self._engine.control.join(self._number, name)
        return {"client": self._number, "control": self._engine.control.state.as_message()}

    async def on_clients(self) -> Result:
        """Return the clients that have told their names, and who has control."""
        return self._engine.control.state.as_message()

    async def on_history(self, count: Annotated[int, Meta(ge=0, le=KEPT_EVENTS)] = 200) -> Result:
        """Return the newest events with their ages, the oldest first."""
        return {
            "events": [
                {"age_s": age_s, "kind": event.kind, "text": event.text}
                for age_s, event in self._engine.past_events(count)
            ]
        }

    async def on_ask_control(self) -> None:
        """Ask the client that has control for it."""
        self._engine.control.ask(self._number)

    async def on_take_control(self) -> None:
        """Take control, whoever has it."""
        self._engine.control.take(self._number)

    async def on_give_control(self, to: Number) -> None:
        """Hand control to another client."""
        self._engine.control.give(self._number, to)

    async def on_keep_control(self) -> None:
        """Refuse the clients that ask for control."""
        self._engine.control.keep(self._number)

    async def on_leave(self) -> Result:
        """End the engine, where this is its only client and nothing runs; say whether it ends."""
        return {"ends": self._engine.end_if_unused("its last client has left")}
