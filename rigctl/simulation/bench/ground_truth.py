"""What really happened on the bench, logged each millisecond by the world itself."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class GroundTruthArrays(NamedTuple):
    """True values, one row a millisecond; row ``i`` ends at ``first_ms + i + 1`` ms world time.

    ``speed_mm_s``: float32 (n,), surface speed of the texture, mean over the millisecond.
    ``force_g``: float32 (n,), contact force between drum and skin at its end.
    ``sync``: uint8 (n,), level of the sync line at its end.
    """

    first_ms: int
    speed_mm_s: NDArray[np.float32]
    force_g: NDArray[np.float32]
    sync: NDArray[np.uint8]


class GroundTruth:
    """Append-only log of true speed, force and sync level, kept in chunks until taken."""

    def __init__(self) -> None:
        self._first_ms = 0
        self._speed: list[NDArray[np.float32]] = []
        self._force: list[NDArray[np.float32]] = []
        self._sync: list[NDArray[np.uint8]] = []

    def append(
        self,
        speed_mm_s: NDArray[np.floating],
        force_g: NDArray[np.floating],
        sync: NDArray[np.integer],
    ) -> None:
        """Log the next milliseconds; the arrays are copied."""
        self._speed.append(speed_mm_s.astype(np.float32))
        self._force.append(force_g.astype(np.float32))
        self._sync.append(sync.astype(np.uint8))

    def arrays(self) -> GroundTruthArrays:
        """Everything logged and not yet taken."""
        return GroundTruthArrays(
            self._first_ms,
            np.concatenate([np.empty(0, np.float32), *self._speed]),
            np.concatenate([np.empty(0, np.float32), *self._force]),
            np.concatenate([np.empty(0, np.uint8), *self._sync]),
        )

    def take(self) -> GroundTruthArrays:
        """Everything logged since the last take; forgets it, so that days fit in memory."""
        taken = self.arrays()
        self._first_ms += len(taken.sync)
        self._speed.clear()
        self._force.clear()
        self._sync.clear()
        return taken
