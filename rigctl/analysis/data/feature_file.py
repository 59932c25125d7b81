"""A feature matrix in an .npy file that is written a few rows at a time.

Rows are written, not stored into a map of the file: the first touch of a mapped page costs more
than the write, and another thread may compute during the write.
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
    """A file of float64 (n_rows, width); a row holds zeros until it is written."""

    def __init__(self, path: Path, n_rows: int, width: int) -> None:
        self.path = path
        self._width = width
        self._buffer = np.empty((0, width))
        self._file = path.open("wb")
        head = {"descr": "<f8", "fortran_order": False, "shape": (n_rows, width)}
        np.lib.format.write_array_header_1_0(self._file, head)
        self._start = self._file.tell()
        self._file.truncate(self._start + n_rows * width * self._buffer.itemsize)

    def buffer(self, n: int) -> Features:
        """Return memory for rows, float64 (n, width), which the next call reuses."""
        if len(self._buffer) < n:
            self._buffer = np.empty((n, self._width))
        return self._buffer[:n]

    def write(self, rows: Sequence[int], features: Features) -> None:
        """Write rows of the file, in ascending order; adjacent rows go in one write."""
        at = 0
        for _, run in groupby(enumerate(rows), lambda pair: pair[1] - pair[0]):
            first, n = rows[at], len(list(run))
            self._file.seek(self._start + first * features[0].nbytes)
            self._file.write(features[at : at + n].data)
            at += n

    def close(self, *, sync: bool) -> None:
        """Close the file; ``sync``: flush it to the file server, so that other machines see it."""
        self._file.flush()
        if sync:
            os.fsync(self._file.fileno())
        self._file.close()
