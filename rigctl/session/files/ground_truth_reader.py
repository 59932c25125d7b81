"""One sitting's log of the world, read through a stretch at a time however long it is."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from rigctl.errors import SessionError
from rigctl.session.read.buffered_array import STRETCH_ROWS, BufferedArray
from rigctl.session.read.folder import attributes

COLUMNS = (
    ("speed_mm_s", "<f4", "mm/s", "true speed of the texture, mean over the millisecond"),
    ("force_g", "<f4", "g", "true contact force at the end of the millisecond"),
    ("sync", "u1", "", "level of the sync line at the end of the millisecond"),
)


class TruthReader:
    """Row i of each column ends at ``first_ms + i + 1`` ms world time. Use it in a ``with``.

    Everything raises SessionError where the file is damaged.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        with self._named():
            self._file = h5py.File(path, "r")
        try:
            with self._named():
                read = attributes(self._file)
                self.first_ms, self.sitting = int(read["first_ms"]), int(read["sitting"])
                columns = {name: self._file[name] for name, *_ in COLUMNS}
        except SessionError:
            self._file.close()
            raise
        self.n_rows = min(int(column.shape[0]) for column in columns.values())
        self._ahead = {
            name: BufferedArray(partial(self._part, column), self.n_rows)
            for name, column in columns.items()
        }

    def __enter__(self) -> TruthReader:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._file.close()

    def window(self, name: str, start: int, stop: int) -> NDArray[Any]:
        """Rows of one column; cheap where windows follow each other."""
        return self._ahead[name].window(start, stop)

    def rises_ms(self) -> NDArray[np.int64]:
        """World time, in ms, of each rise of sync, to the millisecond in which it came."""
        found, last = [np.zeros(0, np.int64)], 0
        for start in range(0, self.n_rows, STRETCH_ROWS):
            high = (self.window("sync", start, start + STRETCH_ROWS) != 0).astype(np.int8)
            rose = np.flatnonzero(np.diff(high, prepend=np.int8(last)) == 1)
            found.append(rose.astype(np.int64) + (start + self.first_ms))
            last = int(high[-1])
        return np.concatenate(found)

    def check(self) -> None:
        """Read everything once."""
        for name, *_ in COLUMNS:
            for start in range(0, self.n_rows, STRETCH_ROWS):
                self.window(name, start, start + STRETCH_ROWS)

    def _part(self, column: Any, start: int, stop: int) -> NDArray[Any]:
        with self._named():
            rows: NDArray[Any] = column[start:stop]
            return rows

    @contextmanager
    def _named(self) -> Iterator[None]:
        try:
            yield
        except (OSError, KeyError) as error:
            raise SessionError(f"{self.path} is damaged: {error}") from error
