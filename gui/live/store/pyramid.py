"""Lowest and highest readings, and spikes, of blocks of samples, so that minutes draw quickly."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gui.live.store.ring import Ring

FACTORS = (16, 64)
"""Samples a block, of each level."""
BLOCKS_A_COLUMN = 4
"""A level is used where a pixel column has at least as many of its blocks.

A block belongs to the column in which it begins, so a sample stands at most a quarter of a column
beside its place.
"""


class PyramidLevel:
    """Blocks of ``factor`` samples: the minimum, the maximum, and whether a spike fell into it."""

    def __init__(self, factor: int, capacity: int, n_taxels: int, n_rows: int) -> None:
        self.factor = factor
        n_blocks = max(1, capacity // factor)
        self.low = Ring(n_blocks, np.dtype((np.uint16, n_taxels)))
        self.high = Ring(n_blocks, np.dtype((np.uint16, n_taxels)))
        self.spikes = Ring(n_blocks, np.dtype((np.uint8, n_rows)))

    def clear(self) -> None:
        """Remove all blocks."""
        for ring in (self.low, self.high, self.spikes):
            ring.clear()

    def extend(self, low: Ring, high: Ring, spikes: Ring, rows_a_block: int) -> None:
        """Append the blocks that are complete in the finer rows, ``rows_a_block`` to a block."""
        first, end = self.low.end, low.end // rows_a_block
        if end <= first:
            return
        pairs = ((self.low, low, np.minimum), (self.high, high, np.maximum))
        for ring, finer, ufunc in (*pairs, (self.spikes, spikes, np.maximum)):
            ring.append(_blocks(finer, ufunc, first, end, rows_a_block))


def _blocks(finer: Ring, ufunc: np.ufunc, first: int, end: int, factor: int) -> NDArray[Any]:
    """Return the blocks ``first`` … ``end - 1``; those whose rows are gone repeat the oldest."""
    rows = finer.between(first * factor, end * factor)
    n_gone = (end - first) - len(rows) // factor
    rows = rows[len(rows) % factor :]
    blocks = ufunc.reduce(rows.reshape(-1, factor, rows.shape[1]), axis=1)
    return np.concatenate([np.repeat(blocks[:1], n_gone, axis=0), blocks]) if n_gone else blocks


class Pyramid:
    """The levels over the rings of readings and spikes."""

    def __init__(self, capacity: int, n_taxels: int, n_rows: int) -> None:
        self.levels = [PyramidLevel(factor, capacity, n_taxels, n_rows) for factor in FACTORS]

    def clear(self) -> None:
        """Remove all blocks."""
        for level in self.levels:
            level.clear()

    def extend(self, samples: Ring, spikes: Ring) -> None:
        """Add the new samples."""
        low, high, below = samples, samples, 1
        for level in self.levels:
            level.extend(low, high, spikes, level.factor // below)
            low, high, spikes, below = level.low, level.high, level.spikes, level.factor

    def level_for(self, samples_a_column: float) -> PyramidLevel | None:
        """Return the coarsest level that is fine enough, or None where single samples are."""
        fits = [s for s in self.levels if s.factor * BLOCKS_A_COLUMN <= samples_a_column]
        return fits[-1] if fits else None
