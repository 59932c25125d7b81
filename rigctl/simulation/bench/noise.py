"""Noise that is the same for a seed whatever the slices in which it is asked for.

Every source has a stream of its own; row *n* of a stream depends on seed, stream and *n* alone.
"""

from __future__ import annotations

from concurrent.futures import Executor, Future
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

BLOCK_ROWS = 1024


class Stream(IntEnum):
    """Sources of chance in the world."""

    LOADCELL = 1
    ADC = 2
    FRICTION = 3
    SESSION = 4
    CONTACT = 5
    SEATING = 6
    SENSOR = 7
    POWER_UP = 8


def generator(seed: int, stream: Stream, counter: int = 0) -> np.random.Generator:
    """A generator for one place of one stream; numpy's fastest, and any seed will do."""
    sequence = np.random.SeedSequence(seed % 2**64, spawn_key=(stream, counter))
    return np.random.Generator(np.random.SFC64(sequence))


class NoiseRows:
    """An endless table of standard normal rows, float32 (…, width), made in blocks.

    ``helper`` makes the block behind the one that is asked for, while others go on.
    """

    def __init__(
        self, seed: int, stream: Stream, width: int, helper: Executor | None = None
    ) -> None:
        self._seed = seed
        self._stream = stream
        self._width = width
        self._helper = helper
        self._blocks: dict[int, NDArray[np.float32]] = {}
        self._coming: dict[int, Future[NDArray[np.float32]]] = {}

    def rows(self, first: int, count: int) -> NDArray[np.float32]:
        """Rows ``first`` … ``first + count - 1``; asked for in rising order."""
        block, place = divmod(first, BLOCK_ROWS)
        if place + count <= BLOCK_ROWS:
            return self._block(block)[place : place + count]
        here = BLOCK_ROWS - place
        return np.concatenate([self._block(block)[place:], self.rows(first + here, count - here)])

    def _block(self, number: int) -> NDArray[np.float32]:
        if number not in self._blocks:
            self._blocks = {k: v for k, v in self._blocks.items() if k >= number - 1}
            coming = self._coming.pop(number, None)
            self._blocks[number] = coming.result() if coming else self._make(number)
            if self._helper is not None:
                self._coming = {number + 1: self._helper.submit(self._make, number + 1)}
        return self._blocks[number]

    def _make(self, number: int) -> NDArray[np.float32]:
        random = generator(self._seed, self._stream, number)
        return random.standard_normal((BLOCK_ROWS, self._width), np.float32)
