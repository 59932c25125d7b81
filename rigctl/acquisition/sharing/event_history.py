"""The engine's latest events, for a client that joins later."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

from rigctl.values import Event

KEPT_EVENTS = 500
EVENT_LETTERS = 500
"""Of the text of one event, so that all of them fit into one message."""


_UNKEPT = ("batch", "prediction")
"""Kinds that the moving finger sends every 100 ms."""


class PastEvent(NamedTuple):
    """An event that was sent before: the loop time in s, its kind and one sentence."""

    at_s: float
    kind: str
    text: str


class EventHistory:
    """Keeps the newest events that have a text."""

    def __init__(self) -> None:
        self._events: deque[PastEvent] = deque(maxlen=KEPT_EVENTS)

    def add(self, event: Event) -> None:
        """Keep an event."""
        if event.text and event.kind not in _UNKEPT:
            self._events.append(PastEvent(event.at_s, event.kind, event.text[:EVENT_LETTERS]))

    def newest(self, count: int) -> list[PastEvent]:
        """Return the newest ``count`` events, the oldest of them first."""
        return list(self._events)[max(0, len(self._events) - count) :]
