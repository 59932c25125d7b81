"""Which clients an engine has and which one of them has control.

Everybody may look, stop the rig and abort a run. Everything else needs control: the first client
has it, hands it over or loses it to one that takes it, and leaves it behind when it goes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from rigctl.errors import WrongUse


@dataclass(frozen=True, slots=True)
class ControlState:
    """The clients as their engine sends them.

    ``clients``: the name of each, by its number. ``holder``: who has control, None for nobody.
    ``asking``: who asks for it, the longest waiting first.
    """

    clients: dict[int, str] = field(default_factory=dict)
    holder: int | None = None
    asking: tuple[int, ...] = ()

    @property
    def holder_name(self) -> str:
        """The name of the one that has control, empty for nobody."""
        return "" if self.holder is None else self.clients.get(self.holder, f"client {self.holder}")

    def as_message(self) -> dict[str, Any]:
        """Return the state as the data of a message."""
        named = [{"id": number, "name": name} for number, name in self.clients.items()]
        return {"clients": named, "holder": self.holder, "asking": list(self.asking)}


def parse_control(data: Mapping[str, Any]) -> ControlState:
    """Return the state in a message's data; missing fields get their defaults.

    Raises ValueError, TypeError, KeyError or AttributeError for data of another version.
    """
    clients = {int(client["id"]): str(client["name"]) for client in data.get("clients", ())}
    holder = data.get("holder")
    asking = tuple(int(number) for number in data.get("asking", ()))
    return ControlState(clients, None if holder is None else int(holder), asking)


class Control:
    """The clients of one engine. ``changed`` gets one sentence on each change."""

    def __init__(self, changed: Callable[[str], None]) -> None:
        self._changed = changed
        self._names: dict[int, str] = {}
        self._asking: list[int] = []
        self._holder: int | None = None

    @property
    def state(self) -> ControlState:
        """The clients that have told their names, and who has control."""
        return ControlState(dict(self._names), self._holder, tuple(self._asking))

    def join(self, client: int, name: str) -> None:
        """Add a client by its name; it gets control where nobody has it."""
        known = client in self._names
        self._names[client] = name
        if self._holder is None:
            self._holder = client
            self._changed(f"{name} has joined and has control")
        elif not known:
            self._changed(f"{name} has joined and watches")

    def leave(self, client: int) -> None:
        """Remove a client; control goes to the one that asked first, else to nobody."""
        self.drop(client, "has left")

    def drop(self, client: int, why: str) -> None:
        """Remove a client as :meth:`leave` does; ``why``: what it has done, for the others."""
        name = self._names.pop(client, None)
        self._asking = [number for number in self._asking if number != client]
        if self._holder == client:
            self._holder = self._asking.pop(0) if self._asking else None
            self._changed(f"{_named(client, name)} {why}; {self._who()} has control")
        elif name is not None:
            self._changed(f"{name} {why}")

    def require(self, client: int) -> None:
        """Give a client control where nobody has it. Raises WrongUse where another one has it."""
        if self._holder is None:
            self.take(client)
        elif self._holder != client:
            raise WrongUse(
                f"{self._who()} has control and this client only watches: ask for control or take "
                "it first; STOP works from everywhere"
            )

    def ask(self, client: int) -> None:
        """Ask the one that has control for it; get it where nobody has it."""
        if self._holder is None:
            self.take(client)
        elif client not in (self._holder, *self._asking):
            self._asking.append(client)
            self._changed(f"{self._name(client)} asks for control; {self._who()} has it")

    def take(self, client: int) -> None:
        """Give a client control, whoever has it."""
        if self._holder != client:
            before = "" if self._holder is None else f" from {self._who()}"
            self._hand_to(client)
            self._changed(f"{self._who()} has taken control{before}")

    def give(self, client: int, to: int) -> None:
        """Hand control over. Raises WrongUse where it is not the client's or ``to`` is nobody."""
        self.require(client)
        if to not in self._names:
            raise WrongUse(f"there is no client {to}: it may have left")
        if to != client:
            self._hand_to(to)
            self._changed(f"{self._name(client)} has given control to {self._who()}")

    def keep(self, client: int) -> None:
        """Refuse those that ask. Raises WrongUse where the client does not have control."""
        self.require(client)
        if self._asking:
            self._asking.clear()
            self._changed(f"{self._who()} keeps control")

    def _hand_to(self, client: int) -> None:
        self._holder = client
        self._names.setdefault(client, _named(client, None))
        self._asking = [number for number in self._asking if number != client]

    def _who(self) -> str:
        return "nobody" if self._holder is None else self._name(self._holder)

    def _name(self, client: int) -> str:
        return _named(client, self._names.get(client))


def _named(client: int, name: str | None) -> str:
    return name or f"client {client}"
