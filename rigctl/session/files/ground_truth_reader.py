"""Read one sitting's log of the simulated world in blocks, however long it is."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from rigctl.errors import SessionError
from rigctl.session.format.annotated_arrays import read_attributes
from rigctl.session.read.buffered_array import BufferedArray, read_blocks

COLUMNS = (
    ("speed_mm_s", "<f4", "mm/s", "true speed of the texture, mean over the millisecond"),
    ("force_g", "<f4", "g", "true contact force at the end of the millisecond"),
    ("sync", "u1", "", "level of the sync line at the end of the millisecond"),
)


class TruthReader:
    """Reader of one log; row i of each column ends at ``first_ms + i + 1`` ms world time.

    Use it in a ``with`` block. All methods raise SessionError for a damaged file.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        with self._translate_errors():
            self._file = h5py.File(path, "r")
        try:
            with self._translate_errors():
                attributes = read_attributes(self._file)
                self.first_ms = int(attributes["first_ms"])
                self.sitting = int(attributes["sitting"])
                columns = {name: self._file[name] for name, *_ in COLUMNS}
        except SessionError:
            self._file.close()
            raise
        self.n_rows = min(int(column.shape[0]) for column in columns.values())
        self._buffers = {
            name: BufferedArray(partial(self._read, column), self.n_rows)
            for name, column in columns.items()
        }

    def __enter__(self) -> TruthReader:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def window(self, name: str, start: int, stop: int) -> NDArray[Any]:
        """Return rows of one column; cheap for windows that follow each other."""
        return self._buffers[name].window(start, stop)

    def rises_ms(self) -> NDArray[np.int64]:
        """Return the world time of each rise of sync, int64 ms: the millisecond of the rise."""
        rises, last = [np.zeros(0, np.int64)], 0
        for start, sync in read_blocks(partial(self.window, "sync"), self.n_rows):
            high = (sync != 0).astype(np.int8)
            rose = np.flatnonzero(np.diff(high, prepend=np.int8(last)) == 1)
            rises.append(rose.astype(np.int64) + (start + self.first_ms))
            last = int(high[-1])
        return np.concatenate(rises)

    def check(self) -> None:
        """Read every column once."""
        for name, *_ in COLUMNS:
            for _ in read_blocks(partial(self.window, name), self.n_rows):
                pass

    def _read(self, column: Any, start: int, stop: int) -> NDArray[Any]:
        with self._translate_errors():
            rows: NDArray[Any] = column[start:stop]
            return rows

    @contextmanager
    def _translate_errors(self) -> Iterator[None]:
        try:
            yield
        except (OSError, KeyError) as error:
            raise SessionError(f"{self.path} is damaged: {error}") from error
