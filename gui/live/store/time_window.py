"""The part of the time axis that the views show."""

from __future__ import annotations

from dataclasses import dataclass

from rigctl.values import SAMPLE_RATE_HZ


@dataclass(frozen=True, slots=True)
class TimeWindow:
    """Positions in samples: the last one shown, how many are shown, and that of time 0."""

    right: int
    span: int
    origin: int

    @property
    def left(self) -> int:
        """The first position shown."""
        return self.right - self.span

    @property
    def left_s(self) -> float:
        """The beginning of the time axis."""
        return (self.left - self.origin) / SAMPLE_RATE_HZ

    @property
    def right_s(self) -> float:
        """The end of the time axis."""
        return (self.right - self.origin) / SAMPLE_RATE_HZ

    def position_of(self, share: float) -> int:
        """Return the position at a share of the width, 0 at the left."""
        return self.left + round(share * self.span)
