"""A session for reading: its parts joined, its trials cut, also while it is still written."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

import numpy as np
from numpy.typing import NDArray

from rigctl.config.rig_config import RigConfig, parse_config
from rigctl.errors import SessionError
from rigctl.protocol import Plan
from rigctl.session.format import layout
from rigctl.session.format.header import SessionHeader
from rigctl.session.format.table_rows import event_of, trial_of
from rigctl.session.format.wiring import wiring_of
from rigctl.session.read.folder import part_number, part_paths
from rigctl.session.read.part import PartReader, Structured
from rigctl.session.read.sample_index import SampleFile, SampleRange, places_of, sample_file
from rigctl.values import Event, Gap, PlannedTrial, TrialRow, Verdict

SCALING_KIND = "scaling"
"""Kind of the events of an import that say what a stored count is, one a taxel."""


@dataclass(frozen=True, slots=True)
class TrialSamples:
    """The window of one trial as it was received.

    ``samples``: uint16 (n, n_taxels); ``counters``: int64 (n,); ``flags``, ``edges``:
    uint8 (n,). n is ``count`` less what was lost; ``position`` (int64 (n,)) says which sample
    of the window each row is, and ``gaps`` names the others by the board's counter.
    """

    first_counter: int
    count: int
    samples: NDArray[np.uint16]
    counters: NDArray[np.int64]
    flags: NDArray[np.uint8]
    edges: NDArray[np.uint8]

    @property
    def complete(self) -> bool:
        """Whether every sample of the window is there."""
        return len(self.counters) == self.count

    @property
    def position(self) -> NDArray[np.int64]:
        """0-based place of each row in the window."""
        return self.counters - self.first_counter

    @property
    def present(self) -> NDArray[np.bool_]:
        """bool (count,): which samples of the window were received."""
        mask = np.zeros(self.count, np.bool_)
        mask[self.position] = True
        return mask

    @property
    def gaps(self) -> tuple[Gap, ...]:
        """Runs of samples that are missing in the window."""
        end = self.first_counter + self.count
        bounds = np.concatenate([[self.first_counter - 1], self.counters, [end]])
        before = np.flatnonzero(np.diff(bounds) > 1)
        return tuple(
            Gap(int(bounds[i]) + 1, int(bounds[i + 1] - bounds[i]) - 1, "missing") for i in before
        )


@dataclass(frozen=True, slots=True)
class TrialDrum:
    """What the drum said during one attempt, approach and retraction included.

    ``polls``: rows of /drum; ``loadcell``: rows of /loadcell. ``polls_s`` and ``loadcell_s``
    (float64) are seconds since the rise of sync by the drum's clock, NaN without a window.
    """

    polls: Structured
    loadcell: Structured
    polls_s: NDArray[np.float64]
    loadcell_s: NDArray[np.float64]


class Session:
    """Reads a session's folder. Close it, or use it in a ``with``.

    ``trials`` is one structured array over all parts, a row an attempt in the order in which
    they ended; indices into it name a trial in every method.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.parts = [PartReader(part) for part in part_paths(path)]
        self._trials = self._join(layout.TRIALS)

    @classmethod
    def open(cls, path: Path) -> Session:
        """Open a session. Raises SessionError for a folder that is none, or is damaged."""
        return cls(path)

    def close(self) -> None:
        """Close its files."""
        for part in self.parts:
            part.close()

    def __enter__(self) -> Session:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def refresh(self) -> None:
        """See what was written since: rows and new parts."""
        for part in self.parts:
            part.refresh()
        known = self.parts[-1].number
        self.parts += [PartReader(p) for p in part_paths(self.path) if part_number(p) > known]
        self._trials = self._join(layout.TRIALS)

    @property
    def header(self) -> SessionHeader:
        """What was known when the session began; each part has its own in ``parts``."""
        return self.parts[0].header

    @property
    def protocol_text(self) -> str:
        """The protocol as it was run."""
        return self.parts[0].text("/protocol_toml")

    @property
    def rig_text(self) -> str:
        """The rig's description as it was at the last start."""
        return self.parts[-1].text("/rig_toml")

    @property
    def config(self) -> RigConfig:
        """The rig's description, read. Raises ConfigError."""
        return parse_config(self.rig_text, str(self.path / layout.RIG_FILE))

    @property
    def wiring(self) -> tuple[int, ...]:
        """The reading of the wire that each column of the samples holds; empty where untold."""
        return wiring_of(self.header, self.parts[0].text("/rig_toml"))

    @property
    def finished(self) -> bool:
        """Whether the last part was closed in order."""
        return self.parts[-1].finished

    @property
    def n_samples(self) -> int:
        """Samples in all parts."""
        return sum(part.n_samples for part in self.parts)

    @property
    def trials(self) -> Structured:
        """All attempts; columns as in the reference page, text as Unicode."""
        return self._trials

    @property
    def gaps(self) -> Structured:
        """All gaps with the number of their ``part``."""
        return self._join(layout.GAPS)

    @property
    def events(self) -> tuple[Event, ...]:
        """All events."""
        return tuple(map(event_of, self._join(layout.EVENTS)))

    def events_of(self, kind: str) -> tuple[Event, ...]:
        """The events of one kind."""
        parts = [(p.number, p.rows_with(layout.EVENTS, "kind", kind)) for p in self.parts]
        return tuple(map(event_of, _joined(parts)))

    @property
    def scaling(self) -> tuple[tuple[float, float], ...]:
        """Offset and scale of each taxel's stored counts; empty where these are the readings."""
        data = [event.data for event in self.events_of(SCALING_KIND)]
        pairs = tuple((float(each["offset"]), float(each["scale"])) for each in data)
        return () if all(pair == (0.0, 1.0) for pair in pairs) else pairs

    def loadcell_lost(self) -> int:
        """Load-cell samples that the host never got."""
        return sum(part.column_sum(layout.DRUM, "loadcell_lost") for part in self.parts)

    def trial_row(self, index: int) -> TrialRow:
        """One attempt as a value."""
        return trial_of(self._trials[index])

    def committed(self) -> NDArray[np.int64]:
        """Indices of the committed trials, by trial id."""
        indices = np.flatnonzero(self._trials["verdict"] == Verdict.COMMITTED.value)
        order = np.argsort(self._trials["trial_id"][indices], kind="stable")
        return indices[order].astype(np.int64)

    def remaining(self, plan: Plan) -> tuple[PlannedTrial, ...]:
        """Trials of the plan that are not committed, in planned order.

        Raises SessionError for the plan of another session.
        """
        if plan.hash != self.header.plan_hash:
            raise SessionError(f"{self.path} was recorded with another protocol or seed")
        done = set(self._trials["trial_id"][self.committed()].tolist())
        return tuple(trial for trial in plan.trials if trial.trial_id not in done)

    def samples(self, index: int) -> NDArray[np.uint16]:
        """Readings of one trial's window, uint16 (n, n_taxels); see :meth:`window` for gaps."""
        part, start, stop = self._rows_of(index)
        return part.read("/taxels/samples", start, stop)

    def sample_files(self) -> tuple[SampleFile, ...]:
        """Where the samples of each of ``parts`` lie."""
        return tuple(map(sample_file, self.parts))

    def places(self, indices: Sequence[int], first_file: int = 0) -> list[SampleRange]:
        """Where the windows of trials lie; ``file`` counts :meth:`sample_files` from the first.

        Raises SessionError for a part that cannot be read.
        """
        rows = self._trials[list(indices)]
        found: dict[int, SampleRange] = {}
        for number, part in enumerate(self.parts):
            chosen = np.flatnonzero(rows["part"] == part.number)
            places = places_of(part, rows[chosen], first_file + number)
            found.update(zip(chosen.tolist(), places, strict=True))
        if len(found) < len(rows):
            lost = rows[min(set(range(len(rows))) - set(found))]
            raise SessionError(
                f"{self.path}: trial {lost['trial_id']} should lie in part {lost['part']}, "
                "which is not there"
            )
        return [found[i] for i in range(len(rows))]

    def window(self, index: int) -> TrialSamples:
        """One trial's window with counters, flags and gaps."""
        part, start, stop = self._rows_of(index)
        row = self._trials[index]
        return TrialSamples(
            int(row["first_counter"]),
            int(row["count"]),
            *(part.read(array.path, start, stop) for array in layout.TAXEL_ARRAYS),
        )

    def drum(self, index: int) -> TrialDrum:
        """Polls and load-cell samples between an attempt's start and end."""
        row = self._trials[index]
        part = self._part(int(row["part"]))
        first = part.first_at(layout.DRUM, "at_s", float(row["started_s"]))
        behind = part.first_at(layout.DRUM, "at_s", float(np.nextafter(row["ended_s"], np.inf)))
        polls = part.rows(layout.DRUM, first, behind)
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
        """Part and rows of a window."""
        row = self._trials[[index]]
        part = self._part(int(row["part"][0]))
        place = places_of(part, row, 0)[0]
        return part, place.start, place.stop

    def _join(self, table: layout.TableLayout) -> Structured:
        parts = [(part.number, part.rows(table)) for part in self.parts]
        if table is layout.TRIALS:  # not what a crash left empty
            parts = [(n, rows[np.isin(rows["verdict"], list(Verdict))]) for n, rows in parts]
        return _joined(parts)


def _joined(parts: Sequence[tuple[int, Structured]]) -> Structured:
    """Rows of a table in all parts, with the number of each row's part."""
    rows: Structured = np.concatenate([rows for _, rows in parts])
    if "part" in (rows.dtype.names or ()):
        return rows
    return _with_part(rows, np.repeat([n for n, _ in parts], [len(r) for _, r in parts]))


def _loadcell_of(part: PartReader, polls: Structured) -> Structured:
    if not len(polls):
        return part.rows(layout.LOADCELL, 0, 0)
    first = part.first_at(layout.LOADCELL, "board_time_us", float(polls["board_time_us"][0]))
    last_us = float(polls["board_time_us"][-1])
    behind = part.first_at(layout.LOADCELL, "board_time_us", np.nextafter(last_us, np.inf))
    return part.rows(layout.LOADCELL, first, behind)


def _with_part(rows: Structured, numbers: NDArray[np.int64]) -> Structured:
    dtype = np.dtype([("part", "i2"), *rows.dtype.descr])
    joined: Structured = np.empty(rows.shape, dtype)
    joined["part"] = numbers
    for name in rows.dtype.names or ():
        joined[name] = rows[name]
    return joined
