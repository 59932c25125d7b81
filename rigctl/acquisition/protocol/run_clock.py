"""The time of a run, and the part of it in which the run worked."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager


class RunClock:
    """Times since the start of a sitting, in loop time that ``now_s`` returns."""

    def __init__(self, now_s: Callable[[], float]) -> None:
        self.now_s = now_s
        self._started_s = now_s()
        self._idle_s = 0.0
        self._idle_since_s: float | None = None

    @property
    def elapsed_s(self) -> float:
        """The time since the start, pauses and questions included."""
        return self.now_s() - self._started_s

    @property
    def busy_s(self) -> float:
        """The time since the start without pauses and questions, the present one included."""
        since_s = self._idle_since_s
        present_s = 0.0 if since_s is None else self.now_s() - since_s
        return self.elapsed_s - self._idle_s - present_s

    @contextmanager
    def idle(self) -> Iterator[None]:
        """Count the time of the block as a pause or a question."""
        outer = self._idle_since_s is not None
        if outer:
            yield
            return
        self._idle_since_s = since_s = self.now_s()
        try:
            yield
        finally:
            self._idle_s += self.now_s() - since_s
            self._idle_since_s = None
