"""Read a session of any layout: join its parts, also while a writer appends to it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from rigctl.session.format import layout
from rigctl.session.format.data_sets import SessionLayout, TableLayout
from rigctl.session.format.experiments import check_experiment
from rigctl.session.format.header import SessionHeader
from rigctl.session.format.table_rows import parse_event
from rigctl.session.read.part import PartReader, StructuredArray
from rigctl.session.read.part_file import part_paths
from rigctl.session.read.sample_index import SAMPLES, locate_windows
from rigctl.values import Event, Verdict


class SessionReader:
    """Reader of a session's folder. Close it, or use it in a ``with`` block.

    ``trials`` is one structured array over all parts, text as Unicode: one row for each attempt in
    the order in which they ended. ``docs/reference/session.md`` lists the columns; every method
    takes an index into it for a trial. A reader of an experiment adds its layout and its values.
    """

    layout: ClassVar[SessionLayout]

    def __init__(self, path: Path) -> None:
        self.path = path
        self.parts: list[PartReader] = []
        self._open_parts(part_paths(path))
        self.trials = self._join(self.layout.trials)

    @classmethod
    def open(cls, path: Path) -> Self:
        """Open a session.

        Raises SessionError for a damaged one, one of another experiment or another kind of folder.
        """
        return cls(path)

    def close(self) -> None:
        """Close the files of all parts."""
        for part in self.parts:
            part.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def refresh(self) -> None:
        """Update to the last flush: new rows and new parts."""
        for part in self.parts:
            part.refresh()
        last = self.parts[-1].number
        paths = part_paths(self.path)
        self._open_parts([path for path in paths if layout.part_number(path) > last])
        self.trials = self._join(self.layout.trials)

    @property
    def header(self) -> SessionHeader:
        """Metadata of the first part; each of ``parts`` has its own."""
        return self.parts[0].header

    @property
    def protocol_text(self) -> str:
        """Protocol of the session, TOML."""
        return self.parts[0].text("/protocol_toml")

    @property
    def rig_text(self) -> str:
        """Description of the rig at the last start, TOML."""
        return self.parts[-1].text("/rig_toml")

    @property
    def finished(self) -> bool:
        """Whether the writer closed the last part."""
        return self.parts[-1].finished

    @property
    def n_samples(self) -> int:
        """Number of samples in all parts."""
        return sum(part.n_samples for part in self.parts)

    @property
    def gaps(self) -> StructuredArray:
        """All gaps, with the number of their ``part``."""
        return self._join(layout.GAPS)

    @property
    def events(self) -> tuple[Event, ...]:
        """Events of all parts."""
        return tuple(map(parse_event, self._join(layout.EVENTS)))

    def events_of(self, kind: str) -> tuple[Event, ...]:
        """Return the events of one kind."""
        parts = [(p.number, p.rows_where(layout.EVENTS, "kind", kind)) for p in self.parts]
        return tuple(map(parse_event, _joined(parts)))

    def committed(self) -> NDArray[np.int64]:
        """Return the indices of the committed trials, int64, in the order of trial ids."""
        indices = np.flatnonzero(self.trials["verdict"] == Verdict.COMMITTED.value)
        order = np.argsort(self.trials["trial_id"][indices], kind="stable")
        return indices[order].astype(np.int64)

    def samples(self, index: int) -> NDArray[np.uint16]:
        """Return the readings of a trial, uint16 (n, n_taxels); :meth:`window` has the gaps."""
        part, start, stop = self._rows_of(index)
        return part.read(SAMPLES, start, stop)

    def _part(self, number: int) -> PartReader:
        return next(part for part in self.parts if part.number == number)

    def _rows_of(self, index: int) -> tuple[PartReader, int, int]:
        """Return the part and the rows [start, stop) of a trial's window."""
        row = self.trials[[index]]
        part = self._part(int(row["part"][0]))
        (window,) = locate_windows(part, row, 0)
        return part, window.start, window.stop

    def _open_parts(self, paths: Sequence[Path]) -> None:
        for path in paths:
            part = PartReader(path)
            self.parts.append(part)
            if part.layout is not self.layout:
                self.close()
                check_experiment(self.path, part.layout, self.layout)

    def _join(self, table: TableLayout) -> StructuredArray:
        parts = [(part.number, part.rows(table)) for part in self.parts]
        if table is self.layout.trials:  # without rows that a crash left empty
            parts = [(n, rows[np.isin(rows["verdict"], list(Verdict))]) for n, rows in parts]
        return _joined(parts)


def _joined(parts: Sequence[tuple[int, StructuredArray]]) -> StructuredArray:
    """Return the rows of a table in all parts, with the number of each row's part."""
    rows: StructuredArray = np.concatenate([rows for _, rows in parts])
    names = rows.dtype.names or ()
    if "part" in names:
        return rows
    joined: StructuredArray = np.empty(rows.shape, [("part", "i2"), *rows.dtype.descr])
    joined["part"] = np.repeat([number for number, _ in parts], [len(r) for _, r in parts])
    for name in names:
        joined[name] = rows[name]
    return joined
