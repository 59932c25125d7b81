"""How fast a counter increases, and how long ago something was."""

from __future__ import annotations

from collections import deque


class RateMeter:
    """Increase of a counter over the last ``window_s`` of loop time."""

    def __init__(self, window_s: float) -> None:
        self._window_s = window_s
        self._readings: deque[tuple[float, int]] = deque()

    def update(self, now_s: float, count: int) -> None:
        """Add a reading of now."""
        self._readings.append((now_s, count))
        while len(self._readings) > 2 and now_s - self._readings[1][0] >= self._window_s:
            self._readings.popleft()

    @property
    def increase(self) -> int:
        """Increase over the window, or since the first reading."""
        return self._readings[-1][1] - self._readings[0][1] if self._readings else 0

    @property
    def per_s(self) -> float:
        """Mean increase per second, at least 0; 0 before the second reading."""
        elapsed_s = self._readings[-1][0] - self._readings[0][0] if self._readings else 0.0
        return max(0.0, self.increase / elapsed_s) if elapsed_s else 0.0


def age_s(seen_s: float | None, now_s: float) -> float | None:
    """Return the time since something was seen, None before it."""
    return None if seen_s is None else max(0.0, now_s - seen_s)
