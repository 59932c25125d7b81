"""Events of the engine: published once, delivered to the session and to every client."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rigctl.boards.links import Consumers
from rigctl.values import Event


class EventBus:
    """Stamps events with loop time and delivers them, in order, to every subscriber.

    A subscriber that raises gets no more; ``on_failure`` is told, and all others have the event.
    """

    def __init__(self, now_s: Callable[[], float], on_failure: Callable[[Exception], None]) -> None:
        self._now_s = now_s
        self._subscribers: Consumers[[Event]] = Consumers(on_failure)

    def subscribe(self, subscriber: Callable[[Event], None]) -> Callable[[], None]:
        """Call ``subscriber`` with every new event; return the function that unsubscribes it."""
        self._subscribers.add(subscriber)
        return lambda: self._subscribers.remove(subscriber)

    def publish(self, kind: str, text: str, **data: Any) -> None:
        """Publish an event that happens now; see :class:`rigctl.values.Event`."""
        self._subscribers.publish(Event(self._now_s(), kind, text, data))
