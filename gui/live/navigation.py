"""Which part of the time axis the views show: the newest samples, or where the user looks."""

from __future__ import annotations

from PySide6.QtCore import QObject, Signal

from gui.live.timeline import TimeWindow
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
