"""The last seconds of samples and spikes, pulled from the engine's live buffer."""

from __future__ import annotations

from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from rigctl.values import SAMPLE_RATE_HZ

SPAN_S = 10
_MARGIN = 256  # rows that may arrive between reading the head and copying


class SampleWindow(Protocol):
    """Newest samples of a live buffer; ``first`` is the number of the oldest."""

    @property
    def first(self) -> int:
        """Samples written before these."""

    @property
    def time_s(self) -> NDArray[np.float64]:
        """Loop times, (n,)."""

    @property
    def counters(self) -> NDArray[np.int64]:
        """The board's counters, (n,)."""

    @property
    def samples(self) -> NDArray[np.uint16]:
        """Readings, (n, taxels)."""

    @property
    def flags(self) -> NDArray[np.uint8]:
        """Bits of the wire, (n,)."""

    @property
    def spikes(self) -> NDArray[np.uint8]:
        """Spikes, (n, neurons)."""

    def __len__(self) -> int: ...


_Window_co = TypeVar("_Window_co", bound=SampleWindow, covariant=True)


class LiveSamples(Protocol[_Window_co]):
    """A live buffer of samples, of the drum's sensor or of the finger's."""

    @property
    def taxel_head(self) -> int:
        """Samples written since the engine started."""

    def taxels(self, n: int) -> _Window_co:
        """Return the newest ``n`` samples."""


class History:
    """A contiguous buffer of the newest samples.

    Each array has twice the necessary length: at its end the newest half moves to the front, so
    that a slice is always contiguous and the cost of a pull depends only on the new samples.
    ``generation`` changes whenever the buffer is cleared.
    """

    def __init__(
        self,
        n_taxels: int,
        n_rows: int,
        capacity: int = SPAN_S * SAMPLE_RATE_HZ,
    ) -> None:
        self.capacity = capacity
        self._counters = np.zeros(2 * capacity, np.int64)
        self._samples = np.zeros((2 * capacity, n_taxels), np.uint16)
        self._flags = np.zeros(2 * capacity, np.uint8)
        self._spikes = np.zeros((2 * capacity, n_rows), np.uint8)
        self.generation = 0
        self.clear()

    def clear(self) -> None:
        """Remove all samples, as after a reconnection."""
        self._end = 0
        self._head = 0
        self.newest_s = 0.0
        self.generation += 1

    def __len__(self) -> int:
        return min(self._end, self.capacity)

    @property
    def counters(self) -> NDArray[np.int64]:
        """Return the board's counters, int64 (n,), ascending."""
        return self._counters[self._end - len(self) : self._end]

    @property
    def samples(self) -> NDArray[np.uint16]:
        """Return the readings in counts, uint16 (n, n_taxels)."""
        return self._samples[self._end - len(self) : self._end]

    @property
    def flags(self) -> NDArray[np.uint8]:
        """Return the bits of the board's wire, uint8 (n,)."""
        return self._flags[self._end - len(self) : self._end]

    @property
    def spikes(self) -> NDArray[np.uint8]:
        """Return the spikes of each sample, uint8 (n, n_rows).

        The drum's columns are SA 1–18, then RA 1–18; the finger's are SA 1–9.
        """
        return self._spikes[self._end - len(self) : self._end]

    def pull(self, live: LiveSamples[SampleWindow]) -> None:
        """Append what the engine wrote since the last pull."""
        n_new = live.taxel_head - self._head
        if n_new <= 0:
            return
        window = live.taxels(min(n_new + _MARGIN, self.capacity))
        first = max(0, self._head - window.first)
        self._head = window.first + len(window)
        self._append(window, self._skip_reboot(window, first))

    def _skip_reboot(self, window: SampleWindow, first: int) -> int:
        """Return the first row after a reboot, at which the counter jumps back; clear the past."""
        jumps = np.flatnonzero(np.diff(window.counters[first:]) <= 0)
        if len(jumps):
            first += int(jumps[-1]) + 1
        has_rebooted = (
            self._end > 0
            and first < len(window)
            and (len(jumps) > 0 or window.counters[first] <= self._counters[self._end - 1])
        )
        if has_rebooted:
            self._end = 0
            self.generation += 1
        return first

    def _append(self, window: SampleWindow, first: int) -> None:
        n = len(window) - first
        if n <= 0:
            return
        if self._end + n > 2 * self.capacity:
            self._move_to_front()
        rows = slice(self._end, self._end + n)
        self._counters[rows] = window.counters[first:]
        self._samples[rows] = window.samples[first:]
        self._flags[rows] = window.flags[first:]
        self._spikes[rows] = window.spikes[first:]
        self._end += n
        self.newest_s = float(window.time_s[-1])

    def _move_to_front(self) -> None:
        n = len(self)
        for array in (self._counters, self._samples, self._flags, self._spikes):
            array[:n] = array[self._end - n : self._end]
        self._end = n
