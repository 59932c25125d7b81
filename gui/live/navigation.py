"""Where the views look: the time window, the cursors, the events, and the lines of both."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Mapping
from typing import Any, NamedTuple

from PySide6.QtCore import QLineF, QObject, QPointF, QRectF, Qt, Signal
from PySide6.QtGui import QColor, QFont, QFontMetricsF, QPainter, QPen, QTransform
from PySide6.QtWidgets import QGraphicsItem

from gui.live.sample_history import TimeWindow
from gui.widgets.theme import Theme, text_scale
from rigctl.values import SAMPLE_RATE_HZ

SPANS_S = (1, 2, 5, 10, 20, 30, 60)
LONGEST_S = 660
SHORTEST_SAMPLES = 50
_LATE_SAMPLES = 300  # without samples for so long, the time axis follows the drum


class Navigation(QObject):
    """Position, length and zero of the time axis; positions are sample numbers.

    Live, the right edge follows the newest sample, or the left one stands at ``trial_start`` and
    the right one stays until the samples reach it. Paused, it stays until the user moves it, and
    samples go on to arrive.
    """

    changed = Signal()
    """Paused or live, or another span."""

    def __init__(self) -> None:
        super().__init__()
        self.is_paused = False
        self.oldest = self.newest = 0
        self._span = self._live_span = 10 * SAMPLE_RATE_HZ
        self._right = self._origin = 0
        self.trial_start: int | None = None

    @property
    def window(self) -> TimeWindow:
        """The part of the time axis that is shown now."""
        if self.is_paused:
            return TimeWindow(self._right, self._span, self._origin)
        if (start := self.trial_start) is not None:
            return TimeWindow(max(start + self._span, self.newest), self._span, start)
        return TimeWindow(self.newest, self._span, self.newest)

    @property
    def is_aligned(self) -> bool:
        """Whether time 0 is the beginning of a trial."""
        return self.trial_start is not None and self.window.origin == self.trial_start

    def align_to(self, trial_start: int | None) -> None:
        """Begin at a trial from now on, None: follow the newest samples; a look back stays."""
        if trial_start != self.trial_start:
            self.trial_start = trial_start
            self.changed.emit()

    @property
    def span_s(self) -> float:
        """Length of the time axis."""
        return self._span / SAMPLE_RATE_HZ

    @property
    def live_span_s(self) -> float:
        """Length of the time axis that returns after a look back."""
        return self._live_span / SAMPLE_RATE_HZ

    def follow(self, oldest: int, newest: int, drum_newest: float) -> None:
        """Take the positions of the oldest and newest samples, and of the drum's newest row."""
        late = drum_newest - newest > _LATE_SAMPLES
        self.oldest, self.newest = oldest, round(drum_newest) if late else newest

    def pause(self) -> None:
        """Stay at the present moment, which becomes time 0 where no trial is."""
        if not self.is_paused:
            window = self.window
            self.is_paused = True
            self._right, self._origin = window.right, window.origin
            self.changed.emit()

    def look_at(self, right: int, origin: int) -> None:
        """Show recorded samples up to a position, with time 0 at ``origin``."""
        self.is_paused = True
        self._right, self._origin = right, origin

    def resume(self) -> None:
        """Follow the newest samples again, with the span from before."""
        if self.is_paused:
            self.is_paused, self._span = False, self._live_span
            self.changed.emit()

    def toggle(self) -> None:
        """Look back, or follow the newest samples again."""
        (self.resume if self.is_paused else self.pause)()

    def set_span(self, span_s: float) -> None:
        """Show so many seconds; a look back keeps its middle."""
        self._live_span = round(span_s * SAMPLE_RATE_HZ)
        self._set_span(self._live_span, 0.5 if self.is_paused else 1.0)

    def scroll(self, samples: int) -> None:
        """Move to later samples, or to earlier ones; this pauses."""
        self.pause()
        self.move_to(self._right + samples)

    def move_to(self, right: int) -> None:
        """Put the right edge at a position between the oldest and the newest sample."""
        least = min(self.oldest + self._span, self.newest)
        self._right = min(max(right, least), max(self.newest, self._origin))

    def zoom(self, factor: float, share: float = 0.5) -> None:
        """Show ``factor`` times as much; the position at a share of the width stays."""
        if self.is_paused:
            self._set_span(round(self._span * factor), share)
            return
        index = min(range(len(SPANS_S)), key=lambda i: abs(SPANS_S[i] - self.span_s))
        index += 1 if factor > 1 else -1
        self.set_span(SPANS_S[min(max(index, 0), len(SPANS_S) - 1)])

    def _set_span(self, span: int, share: float) -> None:
        span = min(max(span, SHORTEST_SAMPLES), LONGEST_S * SAMPLE_RATE_HZ)
        kept = self.window.position_of(share)
        self._span = span
        if self.is_paused:
            self.move_to(kept + round((1 - share) * span))
        self.changed.emit()


class Cursors:
    """``share``: the cursor's place in the width, 0–1, or None; ``reference``: a position."""

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Remove both."""
        self.share: float | None = None
        self.reference: int | None = None

    def position(self, window: TimeWindow) -> int | None:
        """Return the cursor's position."""
        return None if self.share is None else window.position_of(self.share)

    def step(self, samples: int, window: TimeWindow) -> None:
        """Move the cursor by samples, from the middle if there is none; it stays in the window."""
        share = 0.5 if self.share is None else self.share + samples / window.span
        self.share = min(max(share, 0.0), 1.0)

    def set_reference(self, window: TimeWindow) -> None:
        """Put the reference at the cursor."""
        self.reference = self.position(window)

    def lines(self, window: TimeWindow) -> tuple[float | None, float | None]:
        """Return the times of cursor and reference on the window's axis, None where not shown."""
        positions = (self.position(window), self.reference)
        cursor_s, reference_s = (
            None if at is None else (at - window.origin) / SAMPLE_RATE_HZ for at in positions
        )
        return cursor_s, reference_s


_ROOM_PX = 8
_LABEL_PT = 7.5


class MarkLine(NamedTuple):
    """An event at a time of the axis, with its name and whether it is a problem."""

    at_s: float
    name: str
    is_problem: bool


class Overlay(QGraphicsItem):
    """Vertical lines over one plot; ``names_marks``: also write the names of the events."""

    def __init__(self, theme: Theme, names_marks: bool) -> None:
        super().__init__()
        self.theme = theme
        self.marks: list[MarkLine] = []
        self.cursor_s: float | None = None
        self.reference_s: float | None = None
        self._names_marks = names_marks
        self._rect = QRectF(-10.0, 0.0, 10.0, 1.0)
        self.setZValue(10)

    def set_theme(self, theme: Theme) -> None:
        """Apply a theme."""
        self.theme = theme
        self.update()

    def set_rect(self, rect: QRectF) -> None:
        """Set the rectangle of the plot in its own units."""
        if rect != self._rect:
            self.prepareGeometryChange()
            self._rect = rect

    def show_lines(
        self, marks: list[MarkLine], cursor_s: float | None, reference_s: float | None
    ) -> None:
        """Show events and cursors at times of the axis; None hides a cursor."""
        if (marks, cursor_s, reference_s) != (self.marks, self.cursor_s, self.reference_s):
            self.marks, self.cursor_s, self.reference_s = marks, cursor_s, reference_s
            self.update()

    def boundingRect(self) -> QRectF:
        """Return the rectangle of the whole plot."""
        return self._rect

    def paint(self, painter: QPainter, *_: object) -> None:
        """Draw the lines in pixels, so that text and dashes keep their size."""
        if not self.marks and self.cursor_s is None and self.reference_s is None:
            return
        to_pixels = painter.worldTransform()
        painter.save()
        painter.setWorldTransform(QTransform())
        area = to_pixels.mapRect(self._rect)
        self._paint_marks(painter, to_pixels, area)
        for at_s, colour, style in (
            (self.reference_s, self.theme.accent, Qt.PenStyle.DashLine),
            (self.cursor_s, self.theme.text, Qt.PenStyle.SolidLine),
        ):
            if at_s is not None:
                self._paint_line(painter, _x_of(to_pixels, at_s), area, colour, style)
        painter.restore()

    def _paint_marks(self, painter: QPainter, to_pixels: QTransform, area: QRectF) -> None:
        font = QFont(painter.font())
        font.setPointSizeF(_LABEL_PT * text_scale())
        painter.setFont(font)
        metrics, free_from = QFontMetricsF(font), area.left()
        for at_s, name, is_problem in self.marks:
            x = _x_of(to_pixels, at_s)
            colour = self.theme.bad if is_problem else self.theme.muted
            style = Qt.PenStyle.DashDotLine if is_problem else Qt.PenStyle.DotLine
            self._paint_line(painter, x, area, colour, style)
            width = metrics.horizontalAdvance(name)
            if self._names_marks and x >= free_from and x + width + 3 <= area.right():
                painter.drawText(QPointF(x + 3, area.top() + metrics.ascent() + 1), name)
                free_from = x + width + _ROOM_PX

    def _paint_line(
        self, painter: QPainter, x: float, area: QRectF, colour: str, style: Qt.PenStyle
    ) -> None:
        painter.setPen(QPen(QColor(colour), 1, style))
        painter.drawLine(QLineF(x, area.top(), x, area.bottom()))


def _x_of(to_pixels: QTransform, at_s: float) -> float:
    return round(to_pixels.map(QPointF(at_s, 0.0)).x()) + 0.5


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
