"""How the messages and the live data of one experiment's engine are read."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar

from rigctl.acquisition.live_buffer import LiveReader
from rigctl.acquisition.rpc.client import WINDOW, client_name
from rigctl.acquisition.rpc.messages import EngineStatus, parse_status


class LinkedRun(Protocol):
    """A run as the link sees it."""

    @property
    def is_active(self) -> bool:
        """Whether it goes on."""


class LinkedStatus(Protocol):
    """A status message with a run."""

    @property
    def run(self) -> LinkedRun:
        """The run."""


class LinkedLive(Protocol):
    """A reader of live data."""

    def close(self) -> None:
        """Close the file."""


_Status = TypeVar("_Status", bound=LinkedStatus)
_Live = TypeVar("_Live", bound=LinkedLive)


@dataclass(frozen=True, slots=True)
class Dialect(Generic[_Status, _Live]):
    """How the messages and the live data of one experiment's engine are read."""

    parse: Callable[[Mapping[str, Any]], _Status]
    """Raises ValueError for the status of another version."""
    open_live: Callable[[Path], _Live]


DRUM: Dialect[EngineStatus, LiveReader] = Dialect(parse_status, LiveReader)


THIS_WINDOW = "this window"
UNREADABLE = (KeyError, TypeError, ValueError, AttributeError)
"""What values of other types, or missing ones, raise."""


def other_version(what: str) -> str:
    """Return a sentence on what an engine of another version has sent."""
    return (
        f"the engine's {what} cannot be read: it is of another version; use the same version of "
        "rigctl for window and engine. STOP works"
    )


def name_this_window(text: str) -> str:
    """Return a text of the engine in which this window is not one name among others."""
    return text.replace(client_name(WINDOW), THIS_WINDOW)


def status_here(data: Any) -> Any:
    """Return the data of a status in which who ended the run may be this window."""
    run = data.get("run") if isinstance(data, dict) else None
    if not isinstance(run, dict) or not isinstance(run.get("text"), str):
        return data
    return {**data, "run": {**run, "text": name_this_window(run["text"])}}


def readable_event(message: dict[str, Any]) -> dict[str, Any]:
    """Return an event with values of the types that every event has."""
    at_s, data = message.get("at_s"), message.get("data")
    return {
        "event": str(message.get("event")),
        "at_s": float(at_s) if isinstance(at_s, int | float) else 0.0,
        "text": name_this_window(str(message.get("text") or "")),
        "data": data if isinstance(data, dict) else {},
    }
