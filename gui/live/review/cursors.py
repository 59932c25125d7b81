"""The cursor that follows the pointer or the keys, and the reference it is compared with."""

from __future__ import annotations

from gui.live.store.time_window import TimeWindow
from rigctl.values import SAMPLE_RATE_HZ


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
