"""Read the log of one sitting of a simulated world: true speed, force and sync."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.errors import SessionError
from rigctl.session.format.data_sets import (
    DIGESTS,
    TEXTS,
    ArrayLayout,
    Column,
    SessionLayout,
    TableLayout,
)
from rigctl.session.format.digests import DESCRIPTION, FIRST_DIGEST, PREVIOUS_DIGEST, next_digest
from rigctl.session.format.writer_lock import is_being_written
from rigctl.session.hdf5_file import TEXT, DataSetSchema, Hdf5File
from rigctl.session.read.buffered_array import BufferedArray, read_blocks
from rigctl.session.read.part_file import describe_file, open_appended, readable_rows

LAYOUT = "rigctl-world"
LAYOUT_VERSION = 1
PARTIAL = ".partial"
"""Ends the name of a log that is being written, or whose writer was killed."""
_LOG_NAME = re.compile(r"world(?:-([0-9]{4,6}))?\.h5(?:\.partial)?")

COLUMNS = (
    ArrayLayout("/speed_mm_s", "speed_mm_s", "f4", "mm/s", "true speed, mean over the millisecond"),
    ArrayLayout("/force_g", "force_g", "f4", "g", "true force at the end of the millisecond"),
    ArrayLayout("/sync", "sync", "u1", "", "level of the sync line at the end of the millisecond"),
)
END = TableLayout(
    "/end",
    "one row, written when the log was closed",
    1,
    (Column("n_rows", "i8", "ms", "rows of each column"),),
)
TRUTH_LAYOUT = SessionLayout("world", "simulated world", COLUMNS, (END,), END)
_SCHEMA = tuple(
    DataSetSchema(c.path, 1, dtype=np.dtype(f"<{c.type_code}"), tail=()) for c in COLUMNS
)
_WITH_DIGESTS = (
    *(DataSetSchema(t.path, 1, dtype=t.dtype, tail=()) for t in (END, DIGESTS)),
    *(DataSetSchema(path, 0, TEXT) for path, _ in TEXTS),
)

_LIMITS = {"first_ms": 1 << 48, "sitting": 1 << 15}
"""Largest value of each attribute."""
Start = tuple[str, float]
"""Wall clock and loop time at the start of a sitting, as its parts have them."""


def log_name(sitting: int) -> str:
    """Return the file name of a sitting's log."""
    return "world.h5" if sitting == 1 else f"world-{sitting:04d}.h5"


def log_number(path: Path) -> int:
    """Return the number of a log's sitting by its name, from 1; 0 for another file."""
    found = _LOG_NAME.fullmatch(path.name)
    return int(found[1] or 1) if found else 0


def log_paths(folder: Path) -> list[Path]:
    """Return the logs of a session's sittings, in order, a whole one before a partial one."""
    return sorted(filter(log_number, folder.glob("world*")), key=lambda p: (log_number(p), p.name))


@contextmanager
def open_truth(path: Path) -> Iterator[TruthReader]:
    """Open one log. Opening and reading raise SessionError for a damaged file."""
    is_growing = path.suffix == PARTIAL and is_being_written(path.parent)
    with open_appended(path, is_growing) as file:
        yield TruthReader(file)


class TruthReader:
    """Reader of one log; row i of each column ends at ``first_ms + i + 1`` ms world time.

    A log whose writer was killed has the rows that all columns hold. ``start`` is None in logs
    from before 2026-11-23 that lack it.
    """

    def __init__(self, file: Hdf5File) -> None:
        self._file = file
        attributes = file.attributes()
        if (attributes.get("layout"), attributes.get("layout_version")) != (LAYOUT, LAYOUT_VERSION):
            raise SessionError(f"{file.path} is an HDF5 file, but not the log of a simulated world")
        self.first_ms, self.sitting = (
            _integer(file.path, attributes, name, most) for name, most in _LIMITS.items()
        )
        self.start = start_of(attributes) if "start_utc" in attributes else None
        file.check(_SCHEMA)
        # Logs from before there were digests lack all of it.
        self._has_digests = PREVIOUS_DIGEST in attributes or any(
            file.has(schema.path) for schema in _WITH_DIGESTS
        )
        if self._has_digests:
            file.check(_WITH_DIGESTS)
        self.n_rows = min(readable_rows(file, column.path) for column in COLUMNS)
        self._buffers = {
            column.field: BufferedArray(partial(file.rows, column.path), self.n_rows)
            for column in COLUMNS
        }

    def window(self, name: str, start: int, stop: int) -> NDArray[Any]:
        """Return rows of one column; fast if each call continues the last.

        Raises SessionError where one is no number.
        """
        rows = self._buffers[name].window(start, stop)
        if not np.isfinite(rows).all():
            raise SessionError(
                f"{self._file.path} is damaged: {name} is no number in some of the rows "
                f"{start}–{stop}"
            )
        return rows

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
        """Check every row by its digest, so that damage raises SessionError.

        A log from before there were digests is read whole, which finds what its filter notices.
        """
        if not self._has_digests:
            for column in COLUMNS:
                for _ in read_blocks(partial(self.window, column.field), self.n_rows):
                    pass
            return
        is_whole = self._file.path.suffix != PARTIAL
        if is_whole and self._file.shape(END.path)[0] == 0:
            raise self._cut()
        covered = self._check_digests()
        if is_whole:
            self._check_all_covered(covered)

    def _check_digests(self) -> dict[str, int]:
        """Check every digest; return the rows of each data set that they cover."""
        last = FIRST_DIGEST
        covered: dict[str, int] = {}
        n_digests = readable_rows(self._file, DIGESTS.path)
        for stored in self._file.rows(DIGESTS.path, 0, n_digests):
            table = stored["table"].decode("ascii", "replace")
            first, n_rows = int(stored["first_row"]), int(stored["n_rows"])
            rows = self._covered(table, first, n_rows)
            digest = next_digest(last, table, *rows)
            if first != covered.get(table, 0) or stored["digest"] != digest.encode():
                raise self._altered(table, first, n_rows)
            covered[table], last = first + n_rows, digest
        return covered

    def _check_all_covered(self, covered: Mapping[str, int]) -> None:
        if DESCRIPTION not in covered:
            raise self._altered(DIGESTS.path, 0, 1)
        for path in (*(column.path for column in COLUMNS), END.path):
            n_covered, n_rows = covered.get(path, 0), self._file.shape(path)[0]
            if n_covered < n_rows:
                raise self._altered(path, n_covered, n_rows - n_covered)
        if self._file.row(END.path, -1)["n_rows"] != self.n_rows:
            raise self._cut()

    def _covered(self, table: str, first: int, n_rows: int) -> tuple[int, int, bytes]:
        """Return place and bytes of rows that a digest covers."""
        if table == DESCRIPTION:
            return first, n_rows, describe_file(self._file)
        known = {*(column.path for column in COLUMNS), END.path}
        if table not in known or not 0 <= first <= first + n_rows <= self._file.shape(table)[0]:
            raise self._altered(DIGESTS.path, first, n_rows)
        return first, n_rows, self._file.rows(table, first, first + n_rows).tobytes()

    def _cut(self) -> SessionError:
        return SessionError(f"{self._file.path} is damaged: its last rows are missing")

    def _altered(self, table: str, first: int, n_rows: int) -> SessionError:
        return SessionError(
            f"{self._file.path} is damaged: rows {first}–{first + n_rows} of {table} are not those "
            "that were recorded"
        )


def start_of(attributes: Mapping[str, Any]) -> Start:
    """Return the start of a sitting from the attributes of a part or log."""
    start_utc, loop_s = attributes.get("start_utc", ""), attributes.get("start_loop_s", 0.0)
    return str(start_utc), loop_s if isinstance(loop_s, float) else 0.0


def _integer(path: Path, attributes: Mapping[str, Any], name: str, most: int) -> int:
    value = attributes.get(name)
    if not isinstance(value, int) or not 0 <= value <= most:
        raise SessionError(f"{path} is damaged: its attribute {name} is {value}")
    return value
