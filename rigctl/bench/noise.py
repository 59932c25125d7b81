"""Seeded noise that does not depend on how callers slice their requests.

Row *n* of a stream depends only on the seed, the stream and *n*.
"""

from __future__ import annotations

import math
from concurrent.futures import Executor, Future
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from rigctl.kernels import inlined


@inlined
def modulo(position_mm: float, turn_mm: float) -> float:
    """Return ``position_mm % turn_mm`` to the bit; faster for a turn of whole millimetres."""
    if turn_mm != math.floor(turn_mm):
        return position_mm % turn_mm
    within = position_mm - math.floor(position_mm / turn_mm) * turn_mm
    return within + turn_mm if within < 0.0 else within


BLOCK_ROWS = 1024


class NoiseStream(IntEnum):
    """Independent random streams of the simulation."""

    LOADCELL = 1
    ADC = 2
    FRICTION = 3
    SESSION = 4
    CONTACT = 5
    SEATING = 6
    SENSOR = 7
    POWER_UP = 8
    SWITCHES = 9


def random_generator(seed: int, stream: NoiseStream, counter: int = 0) -> np.random.Generator:
    """Return the generator of one block of a stream: numpy's fastest, for any integer seed."""
    sequence = np.random.SeedSequence(seed % 2**64, spawn_key=(stream, counter))
    return np.random.Generator(np.random.SFC64(sequence))


class NoiseRows:
    """An endless table of standard normal rows, float32 (…, width), generated in blocks.

    ``executor``, if given, prefetches the next block.
    """

    def __init__(
        self, seed: int, stream: NoiseStream, width: int, executor: Executor | None = None
    ) -> None:
        self._seed = seed
        self._stream = stream
        self._width = width
        self._executor = executor
        self._blocks: dict[int, NDArray[np.float32]] = {}
        self._prefetched: dict[int, Future[NDArray[np.float32]]] = {}

    def rows(self, first: int, count: int) -> NDArray[np.float32]:
        """Return rows ``first`` … ``first + count - 1``; ``first`` must not decrease."""
        block, row = divmod(first, BLOCK_ROWS)
        if row + count <= BLOCK_ROWS:
            return self._block(block)[row : row + count]
        here = BLOCK_ROWS - row
        return np.concatenate([self._block(block)[row:], self.rows(first + here, count - here)])

    def _block(self, number: int) -> NDArray[np.float32]:
        if number not in self._blocks:
            self._blocks = {k: v for k, v in self._blocks.items() if k >= number - 1}
            future = self._prefetched.pop(number, None)
            self._blocks[number] = future.result() if future else self._generate(number)
            if self._executor is not None:
                following = self._executor.submit(self._generate, number + 1)
                self._prefetched = {number + 1: following}
        return self._blocks[number]

    def _generate(self, number: int) -> NDArray[np.float32]:
        random = random_generator(self._seed, self._stream, number)
        return random.standard_normal((BLOCK_ROWS, self._width), np.float32)
