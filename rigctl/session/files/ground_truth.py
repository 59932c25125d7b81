"""Evaluate the simulated world's own log, ``world.h5`` beside the session.

Only a simulated bench writes it. It gives the true speed and force in each trial, independently
of everything that the rig measured.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.errors import SessionError
from rigctl.session.files.truth_file import (
    Start,
    TruthReader,
    log_number,
    log_paths,
    open_truth,
    start_of,
)
from rigctl.session.files.truth_log import TruthLog
from rigctl.session.format import file_names
from rigctl.session.format.metadata.header import CUT_BY_CLOCK
from rigctl.session.read.part_file import existing_parts, open_part
from rigctl.session.read.session import Session

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
    """Return the truth of each committed trial that a readable log covers, by trial id.

    Calls ``on_trial`` before each trial. :func:`check_truth` raises for a damaged log.
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
        starts[file_names.part_number(path)] = start_of(attributes)
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
    """Return the numbers of the parts of a log's sitting; older logs have its number only."""
    if log.start is not None:
        return [number for number, start in starts.items() if start == log.start]
    return [number for number, sitting in _sittings(starts).items() if sitting == log.sitting]


def begin_log(folder: Path, start: Start, first_ms: int, again: bool = False) -> TruthLog:
    """Begin the log of the sitting with this start, which has its own, as world time begins at 0.

    ``again``: the world has begun from its start once more, so this log replaces an older one of
    the same sitting when it is closed. Raises DiskFault.
    """
    starts = _part_starts(folder)
    own = _log_of(starts, folder, start) if again else None
    sitting = log_number(own) if own is not None else _new_sitting(starts, folder, start)
    return TruthLog(folder, sitting, start, first_ms)


def _log_of(starts: Mapping[int, Start], folder: Path, start: Start) -> Path | None:
    """Return the log of the sitting with this start."""
    for path in log_paths(folder):
        with suppress(SessionError), open_truth(path) as log:  # verify names a damaged one
            if start in [starts[number] for number in _parts_of(log, starts)]:
                return path
    return None


def _new_sitting(starts: Mapping[int, Start], folder: Path, start: Start) -> int:
    """Return the number of a sitting that has no log yet, and perhaps no part."""
    sittings = _sittings(starts)
    own = [sitting for number, sitting in sittings.items() if starts[number] == start]
    number = own[0] if own else max([0, *sittings.values()]) + 1
    return max([number, *(log_number(path) + 1 for path in log_paths(folder))])
