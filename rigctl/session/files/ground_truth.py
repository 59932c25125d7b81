"""Write and evaluate the simulated world's own log, ``world.h5`` beside the session.

Only a simulated bench writes it. It gives the true speed and force in each trial, independently
of everything that the rig measured.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from rigctl.errors import SessionError
from rigctl.session.format import layout
from rigctl.session.format.annotated_arrays import Attributes, write_attributes
from rigctl.session.format.data_sets import LIBVER
from rigctl.session.format.header import CUT_BY_CLOCK
from rigctl.session.hdf5.hdf5_file import Hdf5File
from rigctl.session.hdf5.schema import DataSetSchema
from rigctl.session.read.buffered_array import BufferedArray, read_blocks
from rigctl.session.read.part_file import existing_parts, open_part
from rigctl.session.read.session import Session

TRUTH_PATTERN = "world*.h5"
_LOG_NAME = re.compile(r"world(?:-([0-9]{4,6}))?\.h5")
LAYOUT = "rigctl-world"
LAYOUT_VERSION = 1
CHUNK_ROWS = 65_536
SLACK_MS = 1_000
"""An attempt's rise of sync is between its end and this time before its start."""

COLUMNS = (
    ("speed_mm_s", "<f4", "mm/s", "true speed of the texture, mean over the millisecond"),
    ("force_g", "<f4", "g", "true contact force at the end of the millisecond"),
    ("sync", "u1", "", "level of the sync line at the end of the millisecond"),
)

_SCHEMA = tuple(DataSetSchema(name, 1, dtype=np.dtype(code), tail=()) for name, code, *_ in COLUMNS)
_LIMITS = {"first_ms": 1 << 48, "sitting": 1 << 15}
"""Largest value of each attribute."""

TruthLog = tuple[int, NDArray[np.float32], NDArray[np.float32], NDArray[np.uint8]]
"""First millisecond, then speed in mm/s, force in g and sync, one value for each millisecond."""
Start = tuple[str, float]
"""Wall clock and loop time at the start of a sitting, as its parts have them."""
OnTrial = Callable[[int, int], None]
"""Progress: number of trials done, and of all trials."""


@dataclass(frozen=True, slots=True)
class TrialTruth:
    """Errors of the true means over one committed trial's window, relative to the set-points."""

    trial_id: int
    speed_error: float
    force_error: float


@contextmanager
def open_truth(path: Path) -> Iterator[TruthReader]:
    """Open one log. Opening and reading raise SessionError for a damaged file."""
    with Hdf5File(path) as file:
        yield TruthReader(file)


class TruthReader:
    """Reader of one log; row i of each column ends at ``first_ms + i + 1`` ms world time."""

    def __init__(self, file: Hdf5File) -> None:
        attributes = file.attributes()
        if (attributes.get("layout"), attributes.get("layout_version")) != (LAYOUT, LAYOUT_VERSION):
            raise SessionError(f"{file.path} is an HDF5 file, but not the log of a simulated world")
        self.first_ms, self.sitting = (
            _integer(file.path, attributes, name, most) for name, most in _LIMITS.items()
        )
        self.start = _start_of(attributes) if "start_utc" in attributes else None
        file.check(_SCHEMA)
        self.n_rows = min(file.shape(name)[0] for name, *_ in COLUMNS)
        self._buffers = {
            name: BufferedArray(partial(file.rows, name), self.n_rows) for name, *_ in COLUMNS
        }

    def window(self, name: str, start: int, stop: int) -> NDArray[Any]:
        """Return rows of one column; fast if each call continues the last."""
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
        """Read every column, so that damage raises an error."""
        for name, *_ in COLUMNS:
            for _ in read_blocks(partial(self.window, name), self.n_rows):
                pass


def write_truth(folder: Path, log: TruthLog) -> Path:
    """Write a log, or append its new rows, and return the file.

    Call it at the end of a run, or repeatedly with the rows since the last call. Each sitting of
    a resumed session has its own file, because the world's time starts at 0 again.
    """
    first_ms, speed, force, sync = log
    columns: tuple[NDArray[Any], ...] = (speed, force, sync)
    starts = _part_starts(folder)
    start = starts[max(starts)] if starts else ("", 0.0)
    path = _log_of(folder, start)
    if path is None:
        path, sitting = _new_log_path(folder)
        _create(path, first_ms, sitting, start)
    with h5py.File(path, "r+", libver=LIBVER) as file:
        length = int(file["sync"].shape[0])
        n_stored = int(file.attrs["first_ms"]) + length - first_ms
        if n_stored < 0:
            raise SessionError(
                f"{path} ends {-n_stored} ms before the new rows: part of the truth is missing"
            )
        for (name, *_), values in zip(COLUMNS, columns, strict=True):
            new = values[n_stored:]
            file[name].resize(length + len(new), axis=0)
            file[name][length:] = new
    return path


def check_truth(folder: Path) -> None:
    """Read the logs of all sittings. Raises SessionError for a damaged file."""
    for path in log_paths(folder):
        check_log(path)


def check_log(path: Path) -> None:
    """Read one log. Raises SessionError for a damaged file."""
    with open_truth(path) as log:
        log.check()


def trial_truths(
    session: Session, on_trial: OnTrial = lambda done, trials: None
) -> list[TrialTruth]:
    """Return the truth of each committed trial that a log covers, in the order of trial ids.

    Calls ``on_trial`` before each trial. Raises SessionError for a damaged log.
    """
    committed = session.committed()
    rows = session.trials[committed]
    starts = _part_starts(session.path)
    truths: dict[int, TrialTruth] = {}
    for path in log_paths(session.path):
        with open_truth(path) as log:
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

    Calls ``on_trial`` and raises as :func:`trial_truths` does.
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


def log_paths(folder: Path) -> list[Path]:
    """Return the logs of a session's sittings, in order."""
    return sorted(filter(_log_number, folder.glob(TRUTH_PATTERN)), key=_log_number)


def _log_number(path: Path) -> int:
    """Return the number of a log's sitting by its name, from 1; 0 for another file."""
    found = _LOG_NAME.fullmatch(path.name)
    return int(found[1] or 1) if found else 0


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
        starts[layout.part_number(path)] = _start_of(attributes)
    return starts


def _start_of(attributes: Mapping[str, Any]) -> Start:
    loop_s = attributes.get("start_loop_s", 0.0)
    return str(attributes.get("start_utc", "")), loop_s if isinstance(loop_s, float) else 0.0


def _integer(path: Path, attributes: Mapping[str, Any], name: str, most: int) -> int:
    value = attributes.get(name)
    if not isinstance(value, int) or not 0 <= value <= most:
        raise SessionError(f"{path} is damaged: its attribute {name} is {value}")
    return value


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
    """Return the numbers of the parts of a log's sitting; older logs have its number only."""
    if log.start is not None:
        return [number for number, start in starts.items() if start == log.start]
    return [number for number, sitting in _sittings(starts).items() if sitting == log.sitting]


def _log_of(folder: Path, start: Start) -> Path | None:
    """Return the log of the sitting with this start."""
    starts = _part_starts(folder)
    for path in log_paths(folder):
        with suppress(SessionError), open_truth(path) as log:  # verify names a damaged one
            if start in [starts[number] for number in _parts_of(log, starts)]:
                return path
    return None


def _new_log_path(folder: Path) -> tuple[Path, int]:
    """Return the path of the next sitting's log, and its number: no log has had it."""
    sittings = _sittings(_part_starts(folder)).values()
    number = max([1, *sittings, *(_log_number(path) + 1 for path in log_paths(folder))])
    return folder / ("world.h5" if number == 1 else f"world-{number:04d}.h5"), number


def _create(path: Path, first_ms: int, sitting: int, start: Start) -> None:
    attributes: Attributes = {
        "layout": LAYOUT,
        "layout_version": LAYOUT_VERSION,
        "first_ms": first_ms,
        "sitting": sitting,
        "start_utc": start[0],
        "start_loop_s": start[1],
    }
    with h5py.File(path, "x", libver=LIBVER) as file:
        write_attributes(file, attributes)
        for name, dtype, unit, doc in COLUMNS:
            dataset = file.create_dataset(
                name, (0,), dtype, maxshape=(None,), chunks=(CHUNK_ROWS,), compression=1
            )
            write_attributes(dataset, {"unit": unit or "none", "doc": doc, "shape": "(ms,)"})
