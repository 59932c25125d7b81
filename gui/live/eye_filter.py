"""A high- and a low-pass of the traces for the eye alone: nothing else gets what they make."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gui.live.sample_history import SampleHistory
from rigctl.encoder.reading import Reading
from rigctl.values import SAMPLE_RATE_HZ

ZERO = 32_768
"""What stands for 0 where filtered readings are stored."""
HISTORY = 60 * SAMPLE_RATE_HZ
"""Samples before the filter was chosen that are filtered, too: the longest time axis."""
ORDER = 2


class EyeFilter:
    """Filters samples as they come, causally; its state goes on from block to block.

    ``high_hz``, ``low_hz``: edges of the high-pass and of the low-pass, 0 for none. ``history``:
    filtered readings times ``scale`` above :data:`ZERO`. A gap and a new history begin anew.
    Making the first one loads SciPy, which takes a second.
    """

    def __init__(self, high_hz: float, low_hz: float, reading: Reading = Reading.COUNTS) -> None:
        from scipy.signal import butter, sosfilt_zi

        rate: dict[str, Any] = {"fs": SAMPLE_RATE_HZ, "output": "sos"}
        parts = [butter(ORDER, high_hz, "highpass", **rate)] if high_hz else []
        parts += [butter(ORDER, low_hz, "lowpass", **rate)] if low_hz else []
        self.high_hz, self.low_hz = high_hz, low_hz
        self.scale = 16.0 if reading is Reading.COUNTS else 0.5
        self.history = SampleHistory(1, 1, 1)
        self._sos = np.concatenate(parts)
        self._rest: NDArray[np.float64] = sosfilt_zi(self._sos)
        self._state: NDArray[np.float64] | None = None
        self._source: tuple[SampleHistory | None, int] = (None, -1)
        self._row = self._next = 0

    @property
    def words(self) -> str:
        """What the filter lets through, and that it is for the eye alone."""
        high, low = f"{self.high_hz:g}", f"{self.low_hz:g}"
        band = f"{high}–{low} Hz" if self.high_hz and self.low_hz else ""
        band = band or (f"above {high} Hz" if self.high_hz else f"below {low} Hz")
        return f"{band}, for the eye alone"

    def follow(self, source: SampleHistory) -> None:
        """Filter the samples that came since the last call."""
        ring = source.counters
        if (source, source.generation) != self._source:
            self._source = source, source.generation
            n_taxels = source.samples.between(0, 0).shape[1]
            self.history = SampleHistory(n_taxels, 1, source.capacity)
            self._row, self._next = ring.end - HISTORY, -1
        first, self._row = max(self._row, ring.first), ring.end
        if first >= ring.end:
            return
        positions, samples = ring.between(first, ring.end), source.samples.between(first, ring.end)
        starts = np.flatnonzero(np.diff(positions, prepend=self._next - 1) != 1)
        for begin, end in pairwise([0, *starts[starts > 0].tolist(), len(positions)]):
            if begin in starts:
                self._state = None
            self._append(positions[begin:end], samples[begin:end])
        self._next = int(positions[-1]) + 1

    def decode(self, stored: NDArray[np.uint16]) -> NDArray[np.float64]:
        """Return the filtered readings of the history."""
        return (stored.astype(np.float64) - ZERO) / self.scale

    def _append(self, positions: NDArray[np.int64], samples: NDArray[np.uint16]) -> None:
        from scipy.signal import sosfilt

        if self._state is None:
            self._state = self._rest[:, :, None] * samples[0].astype(np.float64)
        filtered, self._state = sosfilt(self._sos, samples, axis=0, zi=self._state)
        stored = np.clip(np.rint(ZERO + self.scale * filtered), 0, 65_535).astype(np.uint16)
        none = np.zeros(len(positions), np.uint8)
        self.history.append(positions / SAMPLE_RATE_HZ, positions, stored, none, none[:, None])
