"""Tasks of the window's worker processes for the moving finger.

This module does not import Qt, and each task imports its own slow modules.
"""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gui.analysis.tasks.task_values import (
    FingerSessionInfo,
    ScanPicture,
)
from gui.analysis.trials.trial_table import AttemptColumn
from gui.analysis.trials.verdicts import shown_reasons, shown_verdicts
from gui.widgets.file_browser import typed_path
from rigctl.errors import WrongUse

if TYPE_CHECKING:
    from rigctl.analysis.cache import Resources
    from rigctl.analysis.finger.report import FingerReport
    from rigctl.analysis.options import AnalysisOptions
    from rigctl.session.finger_session import FingerSession


def about(session: FingerSession) -> str:
    """Return a sentence about a session of the moving finger."""
    header = session.header
    return (
        f"{session.path.name}: moving finger, {', '.join(header.stages)}; "
        f"{len(session.committed())} of {header.trials_planned} scans committed, "
        f"{'simulated' if header.simulated else 'real'} finger, started {header.start_utc}"
    )


def columns(session: FingerSession) -> tuple[AttemptColumn, ...]:
    """Return the trial table of a session of the moving finger."""
    trials = session.trials
    return (
        AttemptColumn("Scan", np.array(trials["trial_id"]), (), "Number in the planned order"),
        AttemptColumn.of_texts("Plate", trials["texture"]),
        AttemptColumn.of_texts("Profile", trials["profile"], "Planned profile of the velocity"),
        AttemptColumn.of_texts(
            "Named", list(map(_named, trials)), "The answer, and whether it was right"
        ),
        AttemptColumn.of_texts("Verdict", shown_verdicts(session), "Whether the attempt counts"),
        AttemptColumn.of_texts("Why", shown_reasons(session), "Why the attempt does not count"),
    )


def scan_picture(session: FingerSession, row: int, folder: Path) -> ScanPicture:
    """Draw the scan of an attempt into a folder: the last frame of its movie.

    Raises WrongUse for an attempt without a scan.
    """
    from rigctl.analysis.finger.movie import read_timeline, write_movie

    trial_id = int(session.trials[row]["trial_id"])
    path = session.path
    figure = folder / f"{path.name}-{trial_id}.png"
    if not figure.exists():
        write_movie(read_timeline(path, trial_id), figure, lambda *_: None)
    return ScanPicture(str(figure))


def session_info(path: str) -> FingerSessionInfo:
    """Read whose scans a session of the moving finger has. Raises SessionError."""
    from rigctl.session.finger_session import FingerSession

    with FingerSession.open(typed_path(path)) as session:
        header, slides = session.header, session.slides
    person = header.simulation
    return FingerSessionInfo(
        path, header.stages, int(person.get("seed", 0)), int(person.get("session", 0)), slides
    )


def make_models(session: str, source: str, components: int) -> tuple[str, ...]:
    """Train the models of a session, or centre those of ``source`` by its calibration.

    Return their paths. Raises WrongUse where the session has neither stage.
    """
    from rigctl.protocol.finger import Stage
    from rigctl.realtime.finger_models import calibrate_models, train_models

    folder, stages = Path(session), session_info(session).stages
    now = datetime.now(UTC).isoformat(timespec="seconds")
    if Stage.TRAIN in stages:
        return tuple(map(str, train_models(folder, components, now)))
    if Stage.CALIBRATE in stages:
        return tuple(map(str, calibrate_models(typed_path(source), folder)))
    raise WrongUse(f"{folder} has no training or calibration scans: choose another session")


def make_report(options: AnalysisOptions, resources: Resources) -> FingerReport:
    """Write the report of the real-time experiment."""
    from rigctl.analysis.finger.report import make_finger_report

    now = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    settings = options.draw_settings()
    return make_finger_report(options.sessions, options.out, settings, now, resources)


def _named(row: Any) -> str:
    marks = {1: " ✓", 0: " ✗"}
    return f"{row['predicted']}{marks.get(int(row['correct']), '')}" or "–"
