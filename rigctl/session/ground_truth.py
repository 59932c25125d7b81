"""The simulated world's own log beside a session: write, read and evaluate it.

Only a simulated bench has one, ``world.h5`` for the first sitting. It gives the true speed and
force in each trial, independently of everything that the rig measured.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from rigctl.errors import DiskFault, SessionError
from rigctl.session import layout
from rigctl.session.hdf5_file import Attributes, DataSetSchema, Hdf5File, system_reason
from rigctl.session.header import CUT_BY_CLOCK
from rigctl.session.layout import DRUM_TRUTH, ArrayLayout, Column, SessionLayout, TableLayout
from rigctl.session.part import (
    BufferedArray,
    existing_parts,
    open_appended,
    open_part,
    read_blocks,
    readable_rows,
)
from rigctl.session.session import Session
from rigctl.session.writer import PartWriter
from rigctl.session.writer_lock import is_being_written
from rigctl.values import Gap

LAYOUT = "rigctl-world"
LAYOUT_VERSION = 1
PARTIAL = ".partial"
"""Ends the name of a log that is being written, or whose writer was killed."""
_LOG_NAME = re.compile(r"world(?:-([0-9]{4,6}))?\.h5(?:\.partial)?")

END = TableLayout(
    "/end",
    "one row, written when the log was closed",
    1,
    (Column("n_rows", "i8", "ms", "rows of each column"),),
)
Columns = tuple[ArrayLayout, ...]
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
def open_truth(path: Path, columns: Columns = DRUM_TRUTH) -> Iterator[TruthReader]:
    """Open a log with these columns. Opening and reading raise SessionError for a damaged file."""
    is_growing = path.suffix == PARTIAL and is_being_written(path.parent)
    with open_appended(path, is_growing) as file:
        yield TruthReader(file, columns)


class TruthReader:
    """Reader of one log; row i of each column ends at ``first_ms + i + 1`` ms world time.

    A log whose writer was killed has the rows that all columns hold.
    """

    def __init__(self, file: Hdf5File, columns: Columns) -> None:
        self._file = file
        attributes = file.attributes()
        if (attributes.get("layout"), attributes.get("layout_version")) != (LAYOUT, LAYOUT_VERSION):
            raise SessionError(f"{file.path} is an HDF5 file, but not the log of a simulated world")
        self.first_ms, self.sitting = (
            _integer(file.path, attributes, name, most) for name, most in _LIMITS.items()
        )
        self.start = start_of(attributes)
        schema = [
            DataSetSchema(c.path, 1, dtype=np.dtype(f"<{c.type_code}"), tail=()) for c in columns
        ]
        file.check([*schema, DataSetSchema(END.path, 1, dtype=END.dtype, tail=())])
        self.n_rows = min(readable_rows(file, column.path) for column in columns)
        self._buffers = {
            column.field: BufferedArray(partial(file.rows, column.path), self.n_rows)
            for column in columns
        }

    def window(self, name: str, start: int, stop: int) -> NDArray[Any]:
        """Return rows of one column; fast if each call continues the last.

        Raises SessionError where one is no number.
        """
        rows = self._buffers[name].window(start, stop)
        if rows.dtype.kind == "f" and not np.isfinite(rows).all():
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
        """Read every row, so that damage raises SessionError; a whole log says its length."""
        for name in self._buffers:
            for _ in read_blocks(partial(self.window, name), self.n_rows):
                pass
        if self._file.path.suffix == PARTIAL:
            return
        ends = self._file.rows(END.path)["n_rows"].tolist()
        if ends != [self.n_rows]:
            raise SessionError(f"{self._file.path} is damaged: its last rows are missing")


def start_of(attributes: Mapping[str, Any]) -> Start:
    """Return the start of a sitting from the attributes of a part or log."""
    start_utc, loop_s = attributes.get("start_utc", ""), attributes.get("start_loop_s", 0.0)
    return str(start_utc), loop_s if isinstance(loop_s, float) else 0.0


def _integer(path: Path, attributes: Mapping[str, Any], name: str, most: int) -> int:
    value = attributes.get(name)
    if not isinstance(value, int) or not 0 <= value <= most:
        raise SessionError(f"{path} is damaged: its attribute {name} is {value}")
    return value


TruthRows = tuple[Any, ...]
"""First millisecond, then an array for each column of the log, one value for each millisecond."""
_WRITE_ERRORS = (OSError, RuntimeError, DiskFault)
"""What a full disk and HDF5 raise, and the part's writer where its file has lost its name."""


class TruthBlock(SimpleNamespace):
    """Milliseconds in a row, an array for each column of the log besides.

    ``counters`` are those of the world, int64 (n,).
    """

    counters: NDArray[np.int64]
    gaps: tuple[Gap, ...]
    arrived_s: float

    def __len__(self) -> int:
        return len(self.counters)


class TruthLog:
    """The log of one sitting, ``world.h5.partial`` until :meth:`close` gives it its name.

    A killed process leaves the rows of its last :meth:`write`. ``start`` is that of the sitting's
    parts, ``first_ms`` the world time of the first row. Every method raises DiskFault where the
    disk does not take it; the log then ends with the last write that was whole.
    """

    def __init__(
        self, folder: Path, sitting: int, start: Start, first_ms: int, columns: Columns
    ) -> None:
        self._names = [column.field for column in columns]
        self.path = folder / log_name(sitting)
        self._partial = self.path.with_name(self.path.name + PARTIAL)
        self._next_ms = first_ms
        self._part: PartWriter | None = None
        attributes: Attributes = {
            "layout": LAYOUT,
            "layout_version": LAYOUT_VERSION,
            "first_ms": first_ms,
            "sitting": sitting,
            "start_utc": start[0],
            "start_loop_s": start[1],
        }
        try:
            self._partial.unlink(missing_ok=True)
            written = SessionLayout(
                "world", "simulated world", columns, (END,), END, has_digests=False
            )
            self._part = PartWriter(self._partial, written, attributes, 0, ("", ""))
            self._part.write()
        except _WRITE_ERRORS as error:
            raise self._fail(error) from error
        self._n_rows = 0

    def write(self, rows: TruthRows) -> None:
        """Append rows, which must follow those before, and flush them."""
        first_ms, *columns = rows
        n_rows = len(columns[0])
        if first_ms != self._next_ms:
            raise SessionError(
                f"{self._partial} ends at {self._next_ms} ms and the new rows begin at {first_ms} "
                "ms: part of the truth is missing"
            )
        self._next_ms += n_rows
        self._n_rows += n_rows
        counters = np.arange(first_ms, self._next_ms, dtype=np.int64)
        if self._part is None or not n_rows:
            return
        named = dict(zip(self._names, columns, strict=True))
        try:
            self._part.add_samples(TruthBlock(counters=counters, gaps=(), arrived_s=0.0, **named))
            self._part.write()
        except _WRITE_ERRORS as error:
            raise self._fail(error) from error

    def close(self) -> Path:
        """Close the log, give it its name in place of an older one, and return its path."""
        if self._part is None:
            return self._partial
        try:
            self._part.add_rows(END, [(self._n_rows,)])
            self._part.write()
            self._part.sync()
            self._part.close()
            self._part = None
            self._partial.replace(self.path)
        except _WRITE_ERRORS as error:
            raise self._fail(error) from error
        return self.path

    def _fail(self, error: OSError | RuntimeError | DiskFault) -> DiskFault:
        part, self._part = self._part, None
        if part is not None:
            part.abandon()
        reason = error if isinstance(error, DiskFault) else system_reason(error)
        return DiskFault(
            f"{self._partial} could not be written ({reason}): the truth of the simulated world "
            "ends there; make room on the disk"
        )


SLACK_MS = 1_000
"""An attempt's rise of sync is between its end and this time before its start."""

OnTrial = Callable[[int, int], None]
"""Progress: number of trials done, and of all trials."""


@dataclass(frozen=True, slots=True)
class TrialTruth:
    """Errors of the true means over one committed trial's window, relative to the set-points."""

    trial_id: int
    speed_error: float
    force_error: float


def check_log(path: Path) -> None:
    """Read one log. Raises SessionError for a damaged file."""
    with open_truth(path) as log:
        log.check()


def trial_truths(
    session: Session, on_trial: OnTrial = lambda done, trials: None
) -> list[TrialTruth]:
    """Return the truth of each committed trial that a readable log covers, by trial id.

    Calls ``on_trial`` before each trial. :func:`check_log` raises for a damaged log.
    """
    committed = session.committed()
    rows = session.trials[committed]
    starts = _part_starts(session.path)
    truths: dict[int, TrialTruth] = {}
    for path in log_paths(session.path):
        # Damage costs this log only; verify names it.
        with suppress(SessionError), open_truth(path) as log:
            rises = log.rises_ms()
            own = np.flatnonzero(np.isin(rows["part"], _parts_of(log, starts)))
            for i in own[np.argsort(rows["started_s"][own], kind="stable")].tolist():
                on_trial(len(truths), len(rows))
                row = rows[i]
                rise = _last_rise_ms(rises, row)
                if rise is None and session.header.cut_by == CUT_BY_CLOCK:
                    rise = _drum_rise_ms(session, int(committed[i]))
                if rise is not None and rise + int(row["count"]) < log.first_ms + log.n_rows:
                    truths[i] = _trial_truth(log, rise, row)
    return [truths[i] for i in sorted(truths)]


def summarise_truth(
    session: Session, on_trial: OnTrial = lambda done, trials: None
) -> dict[str, Any] | None:
    """Return the ``world`` section of ``rigctl info``; None without a log.

    Calls ``on_trial`` as :func:`trial_truths` does.
    """
    if not log_paths(session.path):
        return None
    truths = trial_truths(session, on_trial)
    speed = [abs(truth.speed_error) * 1000 for truth in truths]
    force = [abs(truth.force_error) * 1000 for truth in truths]
    return {
        "trials": len(truths),
        "max_speed_error_permille": round(max(speed), 4) if speed else None,
        "max_force_error_permille": round(max(force), 4) if force else None,
        "mean_speed_error_permille": round(float(np.mean(speed)), 4) if speed else None,
        "mean_force_error_permille": round(float(np.mean(force)), 4) if force else None,
    }


def _trial_truth(log: TruthReader, rise_ms: int, row: Any) -> TrialTruth:
    """Return the trial's truth: means over its length from the millisecond after the rise."""
    start = rise_ms + 1 - log.first_ms
    stop = start + int(row["count"])
    speed = float(np.mean(np.abs(log.window("speed_mm_s", start, stop)), dtype=np.float64))
    force = float(np.mean(log.window("force_g", start, stop), dtype=np.float64))
    return TrialTruth(
        trial_id=int(row["trial_id"]),
        speed_error=speed / float(row["speed_mm_s"]) - 1,
        force_error=force / float(row["force_g"]) - 1 if row["force_g"] else 0.0,
    )


def _last_rise_ms(rises: NDArray[np.int64], row: Any) -> int | None:
    """Return the attempt's last rise; on a simulated bench, loop time is world time."""
    low = np.searchsorted(rises, float(row["started_s"]) * 1000 - SLACK_MS)
    high = np.searchsorted(rises, float(row["ended_s"]) * 1000)
    return int(rises[high - 1]) if high > low else None


def _drum_rise_ms(session: Session, index: int) -> int | None:
    """Return when the drum opened the window, by its own clock, for a world without a sync wire.

    The result is late by the delay of the drum's last reply, a few milliseconds.
    """
    polls = session.drum(index).polls
    if not len(polls):
        return None
    since_s = (int(polls["board_time_us"][-1]) - int(polls["sync_rise_us"][-1])) * 1e-6
    return round((float(polls["at_s"][-1]) - since_s) * 1000)


def _part_starts(folder: Path) -> dict[int, Start]:
    """Return the start of the sitting of each part that can be read, by the part's number."""
    starts: dict[int, Start] = {}
    for path in existing_parts(folder):
        try:
            with open_part(path) as file:
                attributes = file.attributes()
        except SessionError:
            continue
        starts[layout.part_number(path)] = start_of(attributes)
    return starts


def _sittings(starts: Mapping[int, Start]) -> dict[int, int]:
    """Return the sitting of each part, from 1: every start of the program begins one.

    A missing part between two sittings may have had one of its own, so later ones are not known.
    """
    sittings: dict[int, int] = {}
    last_start, last_number = None, 0
    for number, start in sorted(starts.items()):
        if start != last_start and number > last_number + 1:
            break
        sittings[number] = sittings.get(last_number, 0) + (start != last_start)
        last_start, last_number = start, number
    return sittings


def _parts_of(log: TruthReader, starts: Mapping[int, Start]) -> list[int]:
    """Return the numbers of the parts of a log's sitting."""
    return [number for number, start in starts.items() if start == log.start]


def begin_log(
    folder: Path,
    start: Start,
    first_ms: int,
    again: bool = False,
    columns: Columns = DRUM_TRUTH,
) -> TruthLog:
    """Begin the log of the sitting with this start, which has its own, as world time begins at 0.

    ``again``: the world has begun from its start once more, so this log replaces an older one of
    the same sitting when it is closed. Raises DiskFault.
    """
    own = _log_of(folder, start) if again else None
    sitting = log_number(own) if own is not None else _new_sitting(folder, start)
    return TruthLog(folder, sitting, start, first_ms, columns)


def _log_of(folder: Path, start: Start) -> Path | None:
    """Return the log of the sitting with this start."""
    starts = _part_starts(folder)
    for path in log_paths(folder):
        with suppress(SessionError), open_truth(path) as log:  # verify names a damaged one
            if start in [starts[number] for number in _parts_of(log, starts)]:
                return path
    return None


def _new_sitting(folder: Path, start: Start) -> int:
    """Return the number of a sitting that has no log yet, and perhaps no part."""
    if logs := log_paths(folder):  # its parts need not be read, which are hundreds after weeks
        return log_number(logs[-1]) + 1
    starts = _part_starts(folder)
    sittings = _sittings(starts)
    own = [sitting for number, sitting in sittings.items() if starts[number] == start]
    return own[0] if own else max([0, *sittings.values()]) + 1


TRUTH_PERIOD_S = 5.0
"""Loop time from one write of the ground truth to the next."""


class Truth(Protocol):
    """What a simulated bench logs in memory."""

    @property
    def n_rows(self) -> int:
        """Milliseconds logged and not yet taken."""

    def take(self) -> TruthRows:
        """Return and discard everything logged."""


class TruthRecorder:
    """Logs the truth of a simulated rig beside its sessions; does nothing at a real one.

    ``truth_of``: returns the truth up to the present time, None at a real rig. ``columns``: those
    of its rows. Methods raise DiskFault.
    """

    def __init__(self, truth_of: Callable[[], Truth | None], columns: Columns) -> None:
        self._truth_of = truth_of
        self._columns = columns
        self._log: TruthLog | None = None
        self._due_s = 0.0

    def begin(self, folder: Path, start: Start) -> None:
        """Log into a session from now on. ``start`` is that of the sitting."""
        truth = self._truth_of()
        if truth is not None:
            first_ms, *columns = truth.take()
            self._log = begin_log(folder, start, first_ms + len(columns[0]), columns=self._columns)

    def save(self, now_s: float) -> None:
        """Write the rows since the last write once a period has passed; ``now_s``: loop time.

        Without a log they are dropped, so that a rig may stand for days.
        """
        if now_s >= self._due_s:
            self._due_s = now_s + TRUTH_PERIOD_S
            self._write(self._log)

    def end(self) -> None:
        """Write the last rows and close the log."""
        log, self._log = self._log, None
        self._write(log)
        if log is not None:
            log.close()

    def _write(self, log: TruthLog | None) -> None:
        truth = self._truth_of()
        if truth is not None:
            rows = truth.take()
            if log is not None:
                log.write(rows)
