"""The tasks of the window's worker processes: planning, reading, encoding, classifying.

This module does not import Qt, and each task imports its own slow modules.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable
from datetime import UTC, datetime
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gui.analysis import finger_tasks
from gui.analysis.results import (
    AnalysisResults,
    finger_results,
    prediction_results,
    report_results,
)
from gui.analysis.task_values import (
    AnalysisRequest,
    FingerSessionInfo,
    PlanSummary,
    QuickCheckResult,
    ScanPicture,
    SessionTable,
    TrialData,
    analysis_settings,
    model_path,
)
from gui.widgets.formatting import duration, size
from rigctl.errors import RigctlError

if TYPE_CHECKING:
    from rigctl.analysis.execution.executor import Progress
    from rigctl.analysis.report.report_folder import ReportRequest
    from rigctl.encoding.normalisation import Normalisation
    from rigctl.session.read.session import Session

FIGURES = "figures"
COLUMNS = ("Trial", "Plate", "mm/s", "g", "Verdict")
_RANGE_TRIALS = 100


def serve(pipe: Connection) -> None:
    """Answer (task, args) with ("done", result) or ("failed", sentence) until the pipe closes."""

    def show_progress(stage: str, done: int, total: int) -> None:
        pipe.send(("progress", stage, done / max(total, 1)))

    tasks = WorkerTasks(show_progress)
    while True:
        try:
            task, args = pipe.recv()
        except (EOFError, OSError, KeyboardInterrupt):
            return
        pipe.send(_run(getattr(tasks, task), args))


def _run(task: Callable[..., Any], args: dict[str, Any]) -> tuple[str, Any]:
    try:
        return "done", task(**args)
    except RigctlError as error:
        return "failed", str(error)
    except Exception as error:  # noqa: BLE001  # top of a process: shown in the window
        return "failed", f"{type(error).__name__} in the analysis: {error}"


class WorkerTasks:
    """The tasks of one process, which remembers the open session."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self._path = Path()
        self._is_finger = False
        self._pictures = tempfile.TemporaryDirectory(prefix="rigctl-scans-")
        self._range: Normalisation | None = None

    def plan_protocol(self, path: str, seed: int | None) -> PlanSummary:
        """Plan a protocol as ``rigctl check`` does; None takes the protocol's own seed."""
        from rigctl.protocol.loader import load_protocol

        try:
            plan = load_protocol(Path(path)).plan(seed)
        except RigctlError as error:
            return PlanSummary(problem=str(error))
        time, disk = duration(plan.duration_s), size(plan.bytes_estimate)
        texts = (f"{len(plan.trials)}", f"{plan.plate_changes}", time, disk)
        return PlanSummary(texts, plan.seed)

    def open_session(self, path: str) -> SessionTable:
        """Read a session's trial table. Raises SessionError."""
        from rigctl.session.read.closing_digest import read_closing_digest
        from rigctl.session.read.finger_session import is_finger_session
        from rigctl.session.read.session import Session

        self._path, self._range = Path(path).expanduser(), None
        self._is_finger = is_finger_session(self._path)
        if self._is_finger:
            return finger_tasks.session_table(self._path)
        with Session.open(self._path) as session:
            header, n_committed = session.header, len(session.committed())
            missing = session.describe_missing()
            rows = tuple(map(_trial_texts, session.trials))
        about = (
            f"{self._path.name}: {n_committed} of {header.trials_planned} trials committed, "
            f"{'simulated' if header.simulated else 'real'} rig, started {header.start_utc}"
        )
        about = ". ".join((about, *missing))
        digest = read_closing_digest(self._path)
        return SessionTable(str(self._path), about, COLUMNS, rows, closing_digest=digest)

    def load_trial(self, row: int) -> TrialData | ScanPicture:
        """Read the samples of one attempt and encode them as the live encoder does.

        A scan of the moving finger becomes a picture.
        """
        if self._is_finger:
            return finger_tasks.scan_picture(self._path, row, Path(self._pictures.name))
        from rigctl.encoding.encoder import Encoder
        from rigctl.session.read.session import Session

        with Session.open(self._path) as session:
            samples = np.ascontiguousarray(session.samples(row))
            texts, layout = _trial_texts(session.trials[row]), session.sensor_layout
            if self._range is None:
                self._range = _taxel_range(session)
        title = "Trial {}: plate {}, {} mm/s, {} g, {}".format(*texts)
        counts = Encoder(self._range).encode(samples)
        at, lane = np.nonzero(counts)
        times = counts[at, lane]
        return TrialData(title, samples, np.repeat(lane, times), np.repeat(at, times), layout)

    def quick_check(self, path: str) -> QuickCheckResult:
        """Classify a session's textures as the demo does; write the figures into the session."""
        from rigctl.analysis.report.demo import analyse_session

        answer = analyse_session(Path(path), Path(path) / FIGURES, progress=self._progress)
        sentence = ". ".join((answer.sentence, *answer.remarks))
        return QuickCheckResult(sentence, str(answer.accuracy.with_suffix(".png")))

    def analyse(self, request: AnalysisRequest) -> AnalysisResults:
        """Write a report on sessions as ``rigctl analyse`` does."""
        from rigctl.analysis.data.cache import Cache, Resources, cache_folder
        from rigctl.analysis.report.report_folder import make_report

        now = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
        cache = Cache(cache_folder())
        resources = Resources(cache=cache, progress=self._progress)
        report = make_report(_report_request(request), now, resources)
        cache.trim()
        return report_results(report)

    def analyse_finger(self, request: AnalysisRequest) -> AnalysisResults:
        """Write a report on the moving finger as ``rigctl analyse --experiment realtime`` does."""
        from rigctl.analysis.data.cache import Resources

        resources = Resources(progress=self._progress)
        return finger_results(finger_tasks.make_report(request, resources))

    def classify(self, model: str, sessions: tuple[str, ...]) -> AnalysisResults:
        """Classify sessions with a trained model as ``rigctl classify`` does."""
        from rigctl.analysis.classification.classify_sessions import classify
        from rigctl.analysis.data.cache import Resources
        from rigctl.session.files.model_file import load_model

        loaded = load_model(Path(model).expanduser())
        resources = Resources(progress=self._progress)
        return prediction_results(classify(loaded, tuple(map(Path, sessions)), resources))

    def read_finger_session(self, path: str) -> FingerSessionInfo:
        """Read whose scans a session of the moving finger has. Raises SessionError."""
        return finger_tasks.session_info(path)

    def make_finger_models(self, session: str, source: str, components: int) -> tuple[str, ...]:
        """Train the models of a session, or centre those of ``source`` by its calibration."""
        return finger_tasks.make_models(session, source, components)

    def discard(self, folder: str) -> None:
        """Remove the partial report of a cancelled analysis, whose process could not do so."""
        from rigctl.analysis.data.atomic_directory import PARTIAL

        out = Path(folder).absolute()
        shutil.rmtree(out.with_name(PARTIAL.format(name=out.name)), ignore_errors=True)


def _report_request(request: AnalysisRequest) -> ReportRequest:
    from rigctl.analysis.classification.sweep_engines import SweepEngine
    from rigctl.analysis.classification.training import ModelRequest
    from rigctl.analysis.paper.tasks import SweepSettings
    from rigctl.analysis.report.report_folder import ReportRequest
    from rigctl.encoding.parameters import preset

    out, model = Path(request.folder), None
    tasks = (request.task,) if request.task else ()
    engine = SweepEngine(request.engine)
    if request.representation:
        model = ModelRequest(model_path(out), request.representation, request.components)
    return ReportRequest(
        tuple(map(Path, request.sessions)),
        out,
        SweepSettings(request.draws, request.components, request.seed, engine, tasks),
        preset(request.preset),
        model=model,
        c=Path(request.c).expanduser() if request.c else None,
        sensitivity=request.sensitivity,
        analysis=analysis_settings(request),
    )


def _trial_texts(row: Any) -> tuple[str, ...]:
    return (
        f"{row['trial_id']}",
        f"{row['texture']}",
        f"{row['speed_mm_s']:g}",
        f"{row['force_g']:g}",
        f"{row['verdict']}",
    )


def _taxel_range(session: Session) -> Normalisation:
    """Return the calibrated range of the session, else that of evenly chosen trials."""
    from rigctl.encoding.normalisation import Normalisation

    header = session.header
    if header.taxel_low:
        low, high = (np.array(side, np.uint16) for side in (header.taxel_low, header.taxel_high))
        return Normalisation(low, high, "calibration of the session")
    committed = session.committed()
    chosen = committed[:: max(1, len(committed) // _RANGE_TRIALS)]
    return Normalisation.from_samples(
        map(session.samples, chosen.tolist()), "trials of the session"
    )
