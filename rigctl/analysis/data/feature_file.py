"""A matrix of features in a file as NumPy writes it, made some rows at a time.

Rows are written, not stored into a map of the file: a page that is touched first costs more than
the writing, and another thread may compute meanwhile.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from itertools import groupby
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Features = NDArray[np.float64]


class FeatureFile:
    """float64 (n_rows, width) at ``path``, each row of zeros until it is written."""

    def __init__(self, path: Path, n_rows: int, width: int) -> None:
        self.path = path
        self._width = width
        self._memory = np.empty((0, width))
        self._file = path.open("wb")
        head = {"descr": "<f8", "fortran_order": False, "shape": (n_rows, width)}
        np.lib.format.write_array_header_1_0(self._file, head)
        self._start = self._file.tell()
        self._file.truncate(self._start + n_rows * width * self._memory.itemsize)

    def room(self, n: int) -> Features:
        """Memory for some rows, float64 (n, width), to be used again after they are written."""
        if len(self._memory) < n:
            self._memory = np.empty((n, self._width))
        return self._memory[:n]

    def write(self, rows: Sequence[int], features: Features) -> None:
        """Write rows of the file, ascending; those next to each other at once."""
        at = 0
        for _, run in groupby(enumerate(rows), lambda pair: pair[1] - pair[0]):
            first, n = rows[at], len(list(run))
            self._file.seek(self._start + first * features[0].nbytes)
            self._file.write(features[at : at + n].data)
            at += n

    def close(self, *, for_others: bool) -> None:
        """Let go of it; ``for_others``: other machines see what reached the file server only."""
        self._file.flush()
        if for_others:
            os.fsync(self._file.fileno())
        self._file.close()
