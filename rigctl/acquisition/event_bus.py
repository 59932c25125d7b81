"""What happens is said once and heard everywhere: in the session, and by every client."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rigctl.values import Event

Listener = Callable[[Event], None]


class EventBus:
    """Stamps events with loop time and passes them on, in order, to whoever listens."""

    def __init__(self, now_s: Callable[[], float]) -> None:
        self._now_s = now_s
        self._listeners: list[Listener] = []

    def listen(self, listener: Listener) -> Callable[[], None]:
        """Hear every event from now on; the answer ends that."""
        self._listeners.append(listener)
        return lambda: self._listeners.remove(listener)

    def tell(self, kind: str, text: str, **data: Any) -> None:
        """Something happened now; see :class:`rigctl.values.Event`."""
        event = Event(self._now_s(), kind, text, data)
        for listener in tuple(self._listeners):
            listener(event)
