"""Events on the time axis of the samples."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Mapping
from typing import Any, NamedTuple

from gui.live.review.overlay import MarkLine
from gui.live.store.time_window import TimeWindow
from rigctl.values import SAMPLE_RATE_HZ

KEPT = 4000
PROBLEMS = frozenset({"fault", "stop", "lost", "link", "check"})
SHOWN = PROBLEMS | {
    "trial", "run", "prompt", "pause", "resume", "baseline", "turn", "approach", "note", "encoder",
}  # fmt: skip
"""Kinds of events that the views mark; others stand in the log only."""


class EventMark(NamedTuple):
    """An event at a position."""

    position: float
    kind: str
    name: str
    text: str


class EventMarks:
    """The newest events, in the order of their positions."""

    def __init__(self) -> None:
        self._marks: list[EventMark] = []

    def clear(self) -> None:
        """Remove all events."""
        self._marks.clear()

    def add(self, position: float, kind: str, text: str, data: Mapping[str, Any]) -> None:
        """Add an event if its kind is shown."""
        if kind not in SHOWN:
            return
        number = data.get("trial_id")
        mark = EventMark(position, kind, kind if number is None else f"{kind} {number}", text)
        self._marks.insert(bisect_left(self._marks, mark), mark)
        del self._marks[:-KEPT]

    def within(self, window: TimeWindow) -> list[EventMark]:
        """Return the events in a window, in order."""
        first, end = (
            bisect_left(self._marks, float(at), key=lambda mark: mark.position)
            for at in (window.left, window.right + 1)
        )
        return self._marks[first:end]

    def nearest(self, position: int, within: int) -> EventMark | None:
        """Return the event nearest to a position, at most ``within`` samples away."""
        marks = self.within(TimeWindow(position + within, 2 * within, position))
        return min(marks, key=lambda mark: abs(mark.position - position), default=None)

    def lines(self, window: TimeWindow) -> list[MarkLine]:
        """Return the lines of the events in a window."""
        return [
            MarkLine(
                (mark.position - window.origin) / SAMPLE_RATE_HZ, mark.name, mark.kind in PROBLEMS
            )
            for mark in self.within(window)
        ]
