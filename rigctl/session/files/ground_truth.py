"""What the simulated world itself logged, beside the session: ``world.h5``.

A real bench has no such file. It judges the rig's speed and force in each trial independently
of everything the rig measured.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from rigctl.errors import SessionError
from rigctl.session.files.ground_truth_reader import COLUMNS, TruthReader
from rigctl.session.format import layout
from rigctl.session.format.header import CUT_BY_CLOCK
from rigctl.session.read.folder import attributes, open_part
from rigctl.session.read.session import Session

PATTERN = "world*.h5"
LAYOUT = "rigctl-world"
CHUNK_ROWS = 65_536
SLACK_MS = 1_000
"""A window belongs to an attempt if it begins between its start and end, give or take this."""


@dataclass(frozen=True, slots=True)
class GroundTruthLog:
    """One sitting's log, a row a millisecond; row i ends at ``first_ms + i + 1`` ms world time.

    ``speed_mm_s`` and ``force_g``: float32 (n,); ``sync``: uint8 (n,).
    """

    first_ms: int
    speed_mm_s: NDArray[np.float32]
    force_g: NDArray[np.float32]
    sync: NDArray[np.uint8]
    sitting: int = 1


@dataclass(frozen=True, slots=True)
class TrialTruth:
    """True means over one committed trial's window; errors are relative to the set-points."""

    index: int
    trial_id: int
    speed_mm_s: float
    force_g: float
    speed_error: float
    force_error: float


TruthLog = tuple[int, NDArray[np.float32], NDArray[np.float32], NDArray[np.uint8]]
"""First millisecond, then speed in mm/s, force in g and sync, a value a millisecond."""


def write_truth(folder: Path, log: TruthLog) -> Path:
    """Write a log, or append what is new of it; returns the file.

    Call it at the end of a run, or now and then with what came since. A resumed session gets
    a file of its own for each sitting, because the world's time begins anew.
    """
    first_ms, speed, force, sync = log
    columns: tuple[NDArray[Any], ...] = (speed, force, sync)
    sitting = max(1, len(_sittings(folder)))
    path = folder / ("world.h5" if sitting == 1 else f"world-{sitting:04d}.h5")
    if not path.exists():
        _create(path, first_ms, sitting)
    with h5py.File(path, "r+", libver=layout.LIBVER) as file:
        length = int(file["sync"].shape[0])
        known = int(file.attrs["first_ms"]) + length - first_ms
        if known < 0:
            raise SessionError(f"{path} ends {-known} ms before the log goes on: truth is missing")
        for (name, *_), values in zip(COLUMNS, columns, strict=True):
            new = values[known:]
            file[name].resize(length + len(new), axis=0)
            file[name][length:] = new
    return path


def load_truth(folder: Path) -> list[GroundTruthLog]:
    """The logs of all sittings, in order; empty for a session of a real bench.

    Raises SessionError for a file that is damaged.
    """
    return [_load(path) for path in _logs(folder)]


def check_truth(folder: Path) -> None:
    """Read the logs of all sittings once. Raises SessionError for a file that is damaged."""
    for path in _logs(folder):
        with TruthReader(path) as log:
            log.check()


def trial_truths(
    session: Session, on_trial: Callable[[int, int], None] | None = None
) -> list[TrialTruth]:
    """What was true in each committed trial that a log covers, by trial id.

    ``on_trial`` is told how many trials were looked at, and of how many, before each. Raises
    SessionError for a log that is damaged.
    """
    sittings = _sittings(session.path)
    committed = session.committed()
    rows = session.trials[committed]
    places = {part: n for n, parts in enumerate(sittings, start=1) for part in parts}
    sitting_of = np.array([places.get(part, 0) for part in rows["part"].tolist()], np.int64)
    found: dict[int, TrialTruth] = {}
    for path in _logs(session.path):
        with TruthReader(path) as log:
            rises = log.rises_ms()
            own = np.flatnonzero(sitting_of == log.sitting)
            for place in own[np.argsort(rows["started_s"][own], kind="stable")].tolist():
                if on_trial is not None:
                    on_trial(len(found), len(rows))
                row, index = rows[place], int(committed[place])
                rise = _rise_of(rises, row)
                if rise is None and session.header.cut_by == CUT_BY_CLOCK:
                    rise = _rise_by_the_drum(session, index)
                if rise is not None and rise + int(row["count"]) < log.first_ms + log.n_rows:
                    found[place] = _judge(log, rise, index, row)
    return [found[place] for place in sorted(found)]


def _logs(folder: Path) -> list[Path]:
    return sorted(folder.glob(PATTERN))


def summary(
    session: Session, on_trial: Callable[[int, int], None] | None = None
) -> dict[str, Any] | None:
    """The ``world`` section of ``rigctl info``; None where no log is. As :func:`trial_truths`."""
    if not _logs(session.path):
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


def _judge(log: TruthReader, rise_ms: int, index: int, row: Any) -> TrialTruth:
    """Means over the trial's own length from the millisecond behind the rise's."""
    start = rise_ms + 1 - log.first_ms
    stop = start + int(row["count"])
    speed = float(np.mean(np.abs(log.window("speed_mm_s", start, stop)), dtype=np.float64))
    force = float(np.mean(log.window("force_g", start, stop), dtype=np.float64))
    return TrialTruth(
        index=index,
        trial_id=int(row["trial_id"]),
        speed_mm_s=speed,
        force_g=force,
        speed_error=speed / float(row["speed_mm_s"]) - 1,
        force_error=force / float(row["force_g"]) - 1 if row["force_g"] else 0.0,
    )


def _rise_by_the_drum(session: Session, index: int) -> int | None:
    """When the drum says that it opened the window, without a wire that the world could see.

    By the time that its last reply took to come, some milliseconds, it seems to be later.
    """
    polls = session.drum(index).polls
    if not len(polls):
        return None
    since_s = (int(polls["board_time_us"][-1]) - int(polls["sync_rise_us"][-1])) * 1e-6
    return round((float(polls["at_s"][-1]) - since_s) * 1000)


def _rise_of(rises: NDArray[np.int64], row: Any) -> int | None:
    """The last rise of the attempt; loop time is world time at a simulated bench."""
    low = np.searchsorted(rises, float(row["started_s"]) * 1000 - SLACK_MS)
    high = np.searchsorted(rises, float(row["ended_s"]) * 1000)
    return int(rises[high - 1]) if high > low else None


def _sittings(folder: Path) -> list[list[int]]:
    """Numbers of the parts of each sitting: a new start of the program begins one."""
    found: list[list[int]] = []
    last_start: tuple[str, float] | None = None
    for path in sorted(folder.glob(layout.PART_PATTERN)):
        with open_part(path) as file:
            read = attributes(file)
        start = (str(read["start_utc"]), float(read["start_loop_s"]))
        if start != last_start:
            found.append([])
        last_start = start
        found[-1].append(int(read["part"]))
    return found


def _create(path: Path, first_ms: int, sitting: int) -> None:
    with h5py.File(path, "x", libver=layout.LIBVER) as file:
        layout.describe(
            file,
            {"layout": LAYOUT, "layout_version": 1, "first_ms": first_ms, "sitting": sitting},
        )
        for name, dtype, unit, doc in COLUMNS:
            dataset = file.create_dataset(
                name, (0,), dtype, maxshape=(None,), chunks=(CHUNK_ROWS,), compression=1
            )
            layout.describe(dataset, {"unit": unit or "none", "doc": doc, "shape": "(ms,)"})


def _load(path: Path) -> GroundTruthLog:
    with TruthReader(path) as log:
        speed, force, sync = (log.window(name, 0, log.n_rows) for name, *_ in COLUMNS)
        return GroundTruthLog(log.first_ms, speed, force, sync, log.sitting)
