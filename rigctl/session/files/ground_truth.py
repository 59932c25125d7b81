"""Write and evaluate the simulated world's own log, ``world.h5`` beside the session.

Only a simulated bench writes it. It gives the true speed and force in each trial, independently
of everything that the rig measured.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from rigctl.errors import SessionError
from rigctl.session.format import layout
from rigctl.session.format.annotated_arrays import read_attributes, write_attributes
from rigctl.session.format.data_sets import LIBVER
from rigctl.session.format.header import CUT_BY_CLOCK
from rigctl.session.read.buffered_array import BufferedArray, read_blocks
from rigctl.session.read.part_file import open_part
from rigctl.session.read.session import Session

TRUTH_PATTERN = "world*.h5"
LAYOUT = "rigctl-world"
CHUNK_ROWS = 65_536
SLACK_MS = 1_000
"""An attempt's rise of sync is between its end and this time before its start."""

COLUMNS = (
    ("speed_mm_s", "<f4", "mm/s", "true speed of the texture, mean over the millisecond"),
    ("force_g", "<f4", "g", "true contact force at the end of the millisecond"),
    ("sync", "u1", "", "level of the sync line at the end of the millisecond"),
)

TruthLog = tuple[int, NDArray[np.float32], NDArray[np.float32], NDArray[np.uint8]]
"""First millisecond, then speed in mm/s, force in g and sync, one value for each millisecond."""
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
    try:
        with h5py.File(path, "r") as file:
            yield TruthReader(file)
    except (OSError, KeyError) as error:
        raise SessionError(f"{path} is damaged: {error}") from error


class TruthReader:
    """Reader of one log; row i of each column ends at ``first_ms + i + 1`` ms world time."""

    def __init__(self, file: Any) -> None:
        attributes = read_attributes(file)
        self.first_ms = int(attributes["first_ms"])
        self.sitting = int(attributes["sitting"])
        columns = {name: file[name] for name, *_ in COLUMNS}
        self.n_rows = min(int(column.shape[0]) for column in columns.values())
        self._buffers = {
            name: BufferedArray(partial(_read_rows, column), self.n_rows)
            for name, column in columns.items()
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
    sitting = max(_sittings(folder).values(), default=1)
    path = folder / ("world.h5" if sitting == 1 else f"world-{sitting:04d}.h5")
    if not path.exists():
        _create(path, first_ms, sitting)
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
    for path in _log_paths(folder):
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
    sitting_of_part = _sittings(session.path)
    row_sittings = np.array([sitting_of_part.get(n, 0) for n in rows["part"].tolist()], np.int64)
    truths: dict[int, TrialTruth] = {}
    for path in _log_paths(session.path):
        with open_truth(path) as log:
            rises = log.rises_ms()
            own = np.flatnonzero(row_sittings == log.sitting)
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
    if not _log_paths(session.path):
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


def _log_paths(folder: Path) -> list[Path]:
    return sorted(folder.glob(TRUTH_PATTERN))


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


def _sittings(folder: Path) -> dict[int, int]:
    """Return the sitting of each part, from 1: every start of the program begins one."""
    sittings: dict[int, int] = {}
    sitting, last_start = 0, None
    for path in sorted(folder.glob(layout.PART_PATTERN)):
        with open_part(path) as file:
            attributes = file.attributes()
        start = (attributes["start_utc"], attributes["start_loop_s"])
        sitting += start != last_start
        sittings[int(attributes["part"])] = sitting
        last_start = start
    return sittings


def _create(path: Path, first_ms: int, sitting: int) -> None:
    with h5py.File(path, "x", libver=LIBVER) as file:
        write_attributes(
            file, {"layout": LAYOUT, "layout_version": 1, "first_ms": first_ms, "sitting": sitting}
        )
        for name, dtype, unit, doc in COLUMNS:
            dataset = file.create_dataset(
                name, (0,), dtype, maxshape=(None,), chunks=(CHUNK_ROWS,), compression=1
            )
            write_attributes(dataset, {"unit": unit or "none", "doc": doc, "shape": "(ms,)"})


def _read_rows(column: Any, start: int, stop: int) -> NDArray[Any]:
    rows: NDArray[Any] = column[start:stop]
    return rows
