"""The last seconds of samples and spikes, pulled from the engine's live window."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rigctl.acquisition.live_buffer import LiveView, TaxelWindow
from rigctl.values import N_TAXELS, SAMPLE_RATE_HZ

N_ROWS = 2 * N_TAXELS
SPAN_S = 10
_MARGIN = 256  # rows that may arrive between asking for the head and copying


class History:
    """A contiguous window over the newest samples.

    Each array has twice the room it needs: when the end is reached the newest half moves to
    the front, so that a slice is always contiguous and a pull costs what is new.
    ``generation`` changes whenever the past was forgotten.
    """

    def __init__(self, capacity: int = SPAN_S * SAMPLE_RATE_HZ) -> None:
        self.capacity = capacity
        self._counters = np.zeros(2 * capacity, np.int64)
        self._samples = np.zeros((2 * capacity, N_TAXELS), np.uint16)
        self._spikes = np.zeros((2 * capacity, N_ROWS), np.uint8)
        self.generation = 0
        self.clear()

    def clear(self) -> None:
        """Forget everything, as after a reconnection."""
        self._end = 0
        self._seen = 0
        self.newest_s = 0.0
        self.generation += 1

    def __len__(self) -> int:
        return min(self._end, self.capacity)

    @property
    def counters(self) -> NDArray[np.int64]:
        """Board counters, int64 (n,), ascending."""
        return self._counters[self._end - len(self) : self._end]

    @property
    def samples(self) -> NDArray[np.uint16]:
        """Readings in counts, uint16 (n, 18)."""
        return self._samples[self._end - len(self) : self._end]

    @property
    def spikes(self) -> NDArray[np.uint8]:
        """Spikes in each sample, uint8 (n, 36), rows SA 1–18 then RA 1–18."""
        return self._spikes[self._end - len(self) : self._end]

    def pull(self, live: LiveView) -> int:
        """Take what the engine wrote since the last pull; return the number of samples."""
        waiting = live.heads.taxels - self._seen
        if waiting <= 0:
            return 0
        window = live.taxels(min(waiting + _MARGIN, self.capacity))
        known = max(0, self._seen - window.first)
        self._seen = window.first + len(window)
        return self._take(window, self._after_reboot(window, known))

    def _after_reboot(self, window: TaxelWindow, known: int) -> int:
        """First row to take: where the board's counter goes back, only what follows counts."""
        counters = window.counters[known:]
        back = np.flatnonzero(np.diff(counters) <= 0)
        if len(back):
            known += int(back[-1]) + 1
        begins_anew = (
            self._end > 0
            and known < len(window)
            and (len(back) > 0 or window.counters[known] <= self._counters[self._end - 1])
        )
        if begins_anew:
            self._end = 0
            self.generation += 1
        return known

    def _take(self, window: TaxelWindow, first: int) -> int:
        n = len(window) - first
        if n <= 0:
            return 0
        if self._end + n > 2 * self.capacity:
            self._move_to_front()
        stretch = slice(self._end, self._end + n)
        self._counters[stretch] = window.counters[first:]
        self._samples[stretch] = window.samples[first:]
        self._spikes[stretch] = window.spikes[first:]
        self._end += n
        self.newest_s = float(window.time_s[-1])
        return n

    def _move_to_front(self) -> None:
        n = len(self)
        for array in (self._counters, self._samples, self._spikes):
            array[:n] = array[self._end - n : self._end]
        self._end = n
