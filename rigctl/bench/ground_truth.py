"""Ground truth of the bench: true speed, force and sync level of each millisecond."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

_Columns = tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.uint8]]


class GroundTruthArrays(NamedTuple):
    """True values, one row a millisecond; row ``i`` ends at ``first_ms + i + 1`` ms simulated time.

    ``speed_mm_s``: float32 (n,), mean surface speed of the texture.
    ``force_g``: float32 (n,), contact force between drum and skin at the end.
    ``sync``: uint8 (n,), level of the sync line at the end.
    """

    first_ms: int
    speed_mm_s: NDArray[np.float32]
    force_g: NDArray[np.float32]
    sync: NDArray[np.uint8]

    @property
    def end_ms(self) -> int:
        """World time at the end of the last row."""
        return self.first_ms + len(self.sync)


KEPT_MS = 3_600_000
"""Rows that nobody takes are kept for an hour: 32 MB."""


class GroundTruth:
    """Log of true speed, force and sync level; what is older than an hour is dropped."""

    def __init__(self) -> None:
        self._first_ms = 0
        self._chunks: deque[_Columns] = deque()
        self.n_rows = 0
        """Milliseconds logged and not yet taken."""

    def append(
        self,
        speed_mm_s: NDArray[np.float32],
        force_g: NDArray[np.float32],
        sync: NDArray[np.uint8],
    ) -> None:
        """Append the next milliseconds; the arrays are kept as they are."""
        self._chunks.append((speed_mm_s, force_g, sync))
        self.n_rows += len(sync)
        while self.n_rows - len(self._chunks[0][2]) >= KEPT_MS:
            self._drop(len(self._chunks.popleft()[2]))

    def arrays(self) -> GroundTruthArrays:
        """Return everything logged and not yet taken."""
        empty = np.empty(0, np.float32), np.empty(0, np.float32), np.empty(0, np.uint8)
        speed, force, sync = zip(empty, *self._chunks, strict=True)
        return GroundTruthArrays(
            self._first_ms, np.concatenate(speed), np.concatenate(force), np.concatenate(sync)
        )

    def take(self) -> GroundTruthArrays:
        """Return and discard everything logged, so that a run of days fits in memory."""
        taken = self.arrays()
        self._chunks.clear()
        self._drop(len(taken.sync))
        return taken

    def _drop(self, n_rows: int) -> None:
        self._first_ms += n_rows
        self.n_rows -= n_rows
