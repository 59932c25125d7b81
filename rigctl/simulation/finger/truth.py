"""Ground truth of the finger: its true place, force and plate at each millisecond."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

KEPT_MS = 600_000
"""What nobody takes is kept for ten minutes."""


class FingerTruthArrays(NamedTuple):
    """True values, one row a millisecond; row ``i`` holds at ``first_ms + i + 1`` ms world time.

    ``along_mm``, ``across_mm``, ``height_mm``: float32 (n,), the fingertip on the plate, the middle
    across being 0. ``force_g``: float32 (n,). ``plate``: S1 (n,), the plate under the finger, and
    ``slide``: int32 (n,), the slide's number; before the first slide they are "-" and -1.
    """

    first_ms: int
    along_mm: NDArray[np.float32]
    across_mm: NDArray[np.float32]
    height_mm: NDArray[np.float32]
    force_g: NDArray[np.float32]
    plate: NDArray[np.bytes_]
    slide: NDArray[np.int32]


class FingerTruth:
    """Log of the truth. ``plate`` and ``slide`` are those of the next rows."""

    def __init__(self) -> None:
        self.plate = "-"
        self.slide = -1
        self._first_ms = 0
        self._kept_ms = 0
        self._parts: deque[tuple[NDArray[np.float32], str, int]] = deque()

    def append(self, rows: NDArray[np.float64]) -> None:
        """Append milliseconds: along, across, height, force, float64 (n, 4)."""
        self._parts.append((rows.astype(np.float32), self.plate, self.slide))
        self._kept_ms += len(rows)
        while self._kept_ms > KEPT_MS:
            self._drop(len(self._parts.popleft()[0]))

    def arrays(self) -> FingerTruthArrays:
        """Return everything that is kept and not yet taken."""
        parts = [rows for rows, _, _ in self._parts]
        rows = np.concatenate([np.empty((0, 4), np.float32), *parts])
        sizes = [len(part) for part in parts]
        plates = np.repeat(np.array([plate for _, plate, _ in self._parts], "S1"), sizes)
        slides = np.repeat(np.array([slide for _, _, slide in self._parts], np.int32), sizes)
        along, across, height, force = rows.T.copy()
        return FingerTruthArrays(self._first_ms, along, across, height, force, plates, slides)

    def take(self) -> FingerTruthArrays:
        """Return and discard everything that is kept."""
        taken = self.arrays()
        self._parts.clear()
        self._drop(self._kept_ms)
        return taken

    def _drop(self, count: int) -> None:
        self._first_ms += count
        self._kept_ms -= count
