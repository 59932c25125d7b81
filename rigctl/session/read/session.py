"""Read a session: join its parts and cut its trials, also while a writer appends to it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rigctl.config.rig_config import RigConfig, parse_config
from rigctl.errors import SessionError
from rigctl.session.format import layout
from rigctl.session.format.header import SessionHeader
from rigctl.session.format.table_rows import parse_event, parse_trial
from rigctl.session.format.wiring import session_wiring
from rigctl.session.read.part import PartReader, StructuredArray
from rigctl.session.read.part_file import part_paths
from rigctl.session.read.sample_index import SampleFile, SampleRange, locate_samples, locate_windows
from rigctl.values import Event, Gap, TrialRow, Verdict

SCALING_KIND = "scaling"
"""Kind of an import's events with the scale of the stored counts, one for each taxel."""


@dataclass(frozen=True, slots=True)
class TrialSamples:
    """Received samples of one trial's window.

    ``samples``: uint16 (n, n_taxels); ``counters``: int64 (n,); ``flags``, ``edges``:
    uint8 (n,). n is ``count`` less the lost samples, which ``gaps`` lists by the board's counter.
    """

    first_counter: int
    count: int
    samples: NDArray[np.uint16]
    counters: NDArray[np.int64]
    flags: NDArray[np.uint8]
    edges: NDArray[np.uint8]

    @property
    def complete(self) -> bool:
        """Whether no sample of the window is missing."""
        return len(self.counters) == self.count

    @property
    def gaps(self) -> tuple[Gap, ...]:
        """Runs of missing samples in the window."""
        end = self.first_counter + self.count
        bounds = np.concatenate([[self.first_counter - 1], self.counters, [end]])
        before = np.flatnonzero(np.diff(bounds) > 1)
        return tuple(
            Gap(int(bounds[i]) + 1, int(bounds[i + 1] - bounds[i]) - 1, "missing") for i in before
        )


@dataclass(frozen=True, slots=True)
class TrialDrum:
    """Drum polls and load-cell samples of one attempt, with its approach and retraction.

    ``polls``: rows of /drum; ``loadcell``: rows of /loadcell. ``polls_s`` and ``loadcell_s``
    (float64) are seconds since the rise of sync by the drum's clock, NaN without a window.
    """

    polls: StructuredArray
    loadcell: StructuredArray
    polls_s: NDArray[np.float64]
    loadcell_s: NDArray[np.float64]


class Session:
    """Reader of a session's folder. Close it, or use it in a ``with`` block.

    ``trials`` is one structured array over all parts, text as Unicode: one row for each attempt in
    the order in which they ended. ``docs/reference/session.md`` lists the columns; every method
    takes an index into it for a trial.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.parts = [PartReader(part) for part in part_paths(path)]
        self.trials = self._join(layout.TRIALS)

    @classmethod
    def open(cls, path: Path) -> Session:
        """Open a session. Raises SessionError for a damaged one or another kind of folder."""
        return cls(path)

    def close(self) -> None:
        """Close the files of all parts."""
        for part in self.parts:
            part.close()

    def __enter__(self) -> Session:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def refresh(self) -> None:
        """Update to the last flush: new rows and new parts."""
        for part in self.parts:
            part.refresh()
        last = self.parts[-1].number
        paths = part_paths(self.path)
        self.parts += [PartReader(path) for path in paths if layout.part_number(path) > last]
        self.trials = self._join(layout.TRIALS)

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
    def config(self) -> RigConfig:
        """Parsed description of the rig. Raises ConfigError."""
        return parse_config(self.rig_text, str(self.path / layout.RIG_FILE))

    @property
    def wiring(self) -> tuple[int, ...]:
        """Reading of the taxel wire in each column of the samples; empty if unknown."""
        return session_wiring(self.header, self.parts[0].text("/rig_toml"))

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

    @property
    def scaling(self) -> tuple[tuple[float, float], ...]:
        """Offset and scale of each taxel's stored counts; empty if the counts are the readings."""
        data = [event.data for event in self.events_of(SCALING_KIND)]
        pairs = tuple((float(each["offset"]), float(each["scale"])) for each in data)
        return () if all(pair == (0.0, 1.0) for pair in pairs) else pairs

    def loadcell_lost(self) -> int:
        """Return the number of load-cell samples that the host never received."""
        return sum(int(part.rows(layout.DRUM)["loadcell_lost"].sum()) for part in self.parts)

    def trial_row(self, index: int) -> TrialRow:
        """Return one attempt."""
        return parse_trial(self.trials[index])

    def committed(self) -> NDArray[np.int64]:
        """Return the indices of the committed trials, int64, in the order of trial ids."""
        indices = np.flatnonzero(self.trials["verdict"] == Verdict.COMMITTED.value)
        order = np.argsort(self.trials["trial_id"][indices], kind="stable")
        return indices[order].astype(np.int64)

    def samples(self, index: int) -> NDArray[np.uint16]:
        """Return the readings of a trial, uint16 (n, n_taxels); :meth:`window` has the gaps."""
        part, start, stop = self._rows_of(index)
        return part.read("/taxels/samples", start, stop)

    def sample_files(self) -> tuple[SampleFile, ...]:
        """Return the chunk index of the samples of each of ``parts``."""
        return tuple(map(locate_samples, self.parts))

    def sample_ranges(self, indices: Sequence[int], first_file: int = 0) -> list[SampleRange]:
        """Return the rows of trials' windows; ``first_file`` is the first part's ``file``.

        Raises SessionError for a part that is missing or that HDF5 cannot read.
        """
        rows = self.trials[list(indices)]
        ranges: dict[int, SampleRange] = {}
        for number, part in enumerate(self.parts):
            chosen = np.flatnonzero(rows["part"] == part.number)
            windows = locate_windows(part, rows[chosen], first_file + number)
            ranges.update(zip(chosen.tolist(), windows, strict=True))
        if len(ranges) < len(rows):
            lost = rows[min(set(range(len(rows))) - set(ranges))]
            raise SessionError(
                f"{self.path}: trial {lost['trial_id']} should be in part {lost['part']}, "
                "which is missing"
            )
        return [ranges[i] for i in range(len(rows))]

    def window(self, index: int) -> TrialSamples:
        """Return one trial's window with counters, flags and gaps."""
        part, start, stop = self._rows_of(index)
        row = self.trials[index]
        return TrialSamples(
            int(row["first_counter"]),
            int(row["count"]),
            *(part.read(array.path, start, stop) for array in layout.TAXEL_ARRAYS),
        )

    def drum(self, index: int) -> TrialDrum:
        """Return the polls and load-cell samples between an attempt's start and end."""
        row = self.trials[index]
        part = self._part(int(row["part"]))
        polls = part.rows_between(layout.DRUM, "at_s", row["started_s"], row["ended_s"])
        loadcell = _loadcell_of(part, polls)
        rise_us = float(polls["sync_rise_us"][-1]) if len(polls) else np.nan
        if row["first_counter"] < 0:
            rise_us = np.nan
        return TrialDrum(
            polls,
            loadcell,
            (polls["board_time_us"] - rise_us) * 1e-6,
            (loadcell["board_time_us"] - rise_us) * 1e-6,
        )

    def _part(self, number: int) -> PartReader:
        return next(part for part in self.parts if part.number == number)

    def _rows_of(self, index: int) -> tuple[PartReader, int, int]:
        """Return the part and the rows [start, stop) of a trial's window."""
        row = self.trials[[index]]
        part = self._part(int(row["part"][0]))
        (window,) = locate_windows(part, row, 0)
        return part, window.start, window.stop

    def _join(self, table: layout.TableLayout) -> StructuredArray:
        parts = [(part.number, part.rows(table)) for part in self.parts]
        if table is layout.TRIALS:  # without rows that a crash left empty
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


def _loadcell_of(part: PartReader, polls: StructuredArray) -> StructuredArray:
    """Return the load-cell samples between the first and the last poll."""
    if not len(polls):
        return part.rows(layout.LOADCELL, 0, 0)
    board_us = polls["board_time_us"]
    return part.rows_between(layout.LOADCELL, "board_time_us", board_us[0], board_us[-1])
