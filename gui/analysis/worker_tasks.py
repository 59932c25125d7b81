"""The tasks of the window's worker processes: planning, reading, encoding, classifying.

This module does not import Qt, and each task imports its own slow modules.
"""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Callable
from datetime import UTC, datetime
from functools import cache
from importlib import import_module
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gui.analysis.open_sessions import (
    OpenSessions,
    ResponseGrid,
    compare_responses,
    finger_session_info,
    load_encoder,
    make_finger_models,
    report_on_finger,
    write_movie,
)
from gui.analysis.results import (
    AnalysisResults,
    finger_results,
    prediction_results,
    quick_results,
    report_results,
    verify_results,
)
from gui.analysis.task_values import (
    FoundSessions,
    NeuronVoltage,
    ScanPicture,
    Section,
    SessionLines,
    TrialData,
)
from gui.analysis.trial_overlay import TrialOverlay, overlay_trials
from gui.analysis.trial_sections import ReplayTrial, replay_trial
from gui.protocol import run_tasks
from gui.protocol.run_tasks import (
    SessionNews,
)
from gui.widgets.typed_paths import typed_path
from rigctl.errors import RigctlError
from rigctl.values import RECORDING, SessionLine

if TYPE_CHECKING:
    from rigctl.analysis.executors import Progress
    from rigctl.analysis.learning_curve import GrowingCurve, SessionCurve
    from rigctl.analysis.options import AnalysisOptions


ENGINE_FIRST = 10
"""By how much a process is nicer than the engine, beside which it works through a whole run."""


def serve(pipe: Connection) -> None:
    """Answer (task, args) with ("done", result) or ("failed", sentence) until the pipe closes."""

    def show_progress(stage: str, done: int, total: int) -> None:
        pipe.send(("progress", stage, done / max(total, 1)))

    tasks = WorkerTasks(show_progress)
    while True:
        try:
            task, args = pipe.recv()
            pipe.send(_run(getattr(tasks, task), args))
        except (EOFError, OSError, KeyboardInterrupt):  # the window has ended, perhaps by force
            return


def _run(task: Callable[..., Any], args: dict[str, Any]) -> tuple[str, Any]:
    try:
        return "done", task(**args)
    except RigctlError as error:
        return "failed", str(error)
    except Exception as error:  # noqa: BLE001  # top of a process: shown in the window
        return "failed", f"{type(error).__name__} in the analysis: {error}"


def _files_of(path: str) -> frozenset[tuple[str, int, int]] | None:
    """Return name, time and size of a session's files, None where they cannot be listed."""
    try:
        with os.scandir(path) as entries:
            stats = [(entry.name, entry.stat()) for entry in entries]
    except OSError:
        return None
    return frozenset((name, stat.st_mtime_ns, stat.st_size) for name, stat in stats)


@cache
def _let_engine_first() -> None:
    if sys.platform != "win32":
        os.nice(ENGINE_FIRST)


class WorkerTasks:
    """The tasks of one process, which holds the sessions open that it reads trials of."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self._sessions = sessions = OpenSessions()
        self.open_session, self.follow_session = sessions.open, sessions.follow
        self.note_trial = sessions.note
        self.session_age, self.leave_out = sessions.age_s, sessions.leave_out
        self.judge_trials = sessions.judge
        self._follower = run_tasks.SessionFollower()
        self._growing: GrowingCurve | None = None
        self._lines: dict[str, tuple[object, SessionLine]] = {}

    plan_protocol = staticmethod(run_tasks.plan_protocol)
    free_space = staticmethod(run_tasks.free_space)
    read_protocol = staticmethod(run_tasks.read_protocol)
    check_text = staticmethod(run_tasks.check_text)
    save_protocol = staticmethod(run_tasks.save_protocol)
    read_finger_session = staticmethod(finger_session_info)
    make_finger_models = staticmethod(make_finger_models)
    load_encoder = staticmethod(load_encoder)

    def follow_run(self, folder: str, known: int) -> SessionNews:
        """Read the attempts of a session after the first ``known`` ones, and its notes."""
        return self._follower.read(folder, known)

    def find_sessions(self, folder: str) -> FoundSessions:
        """Return the sessions below a folder, the newest first. Raises SessionError."""
        from rigctl.session.summary import find_sessions

        return FoundSessions(tuple(map(str, find_sessions(Path(folder)))))

    def read_session_lines(self, paths: tuple[str, ...]) -> SessionLines:
        """Return what a list says of sessions; what has not changed is not read again."""
        return SessionLines(tuple(map(self._line, paths)))

    def _line(self, path: str) -> SessionLine:
        from rigctl.session.summary import read_line

        files = _files_of(path)
        known, line = self._lines.get(path, (None, None))
        if line is None or line.state == RECORDING or known != files:
            line = read_line(Path(path))
            self._lines[path] = files, line
        return line

    def learning_curve(self, folder: str) -> SessionCurve:
        """Return the learning curve of a session's trials so far. Raises SessionError."""
        from rigctl.analysis.learning_curve import GrowingCurve

        _let_engine_first()
        if self._growing is None or self._growing.session.path != Path(folder):
            before, self._growing = self._growing, GrowingCurve(Path(folder))
            if before is not None:
                before.session.close()
        return self._growing.curve(self._progress)

    def write_note(self, folder: str, **note: Any) -> SessionNews:
        """Add a note to a session; return the session anew."""
        run_tasks.write_note(folder, **note)
        return self._follower.read(folder)

    def prepare(self) -> None:
        """Load what reading a session takes, before it is wanted."""
        import_module("rigctl.session.session")

    def load_trial(self, path: str, row: int, pictures: str) -> TrialData | ScanPicture:
        """Read an attempt of an open session; a scan becomes a picture in ``pictures``."""
        return self._sessions.trial(path, row, Path(pictures))

    def load_replay(self, path: str, row: int, right: int) -> ReplayTrial:
        """Read an attempt of an open session of the drum, around a sample, for the live views."""
        return replay_trial(self._sessions.encoded(path, row), right)

    def trial_section(self, path: str, row: int, first: int, end: int, factor: int) -> Section:
        """Read samples of an attempt of the drum, or the extremes of ``factor`` of them each."""
        return self._sessions.encoded(path, row).section(first, end, factor)

    def compare_trials(
        self, trials: list[tuple[str, int]], train: int, neuron: str
    ) -> ResponseGrid:
        """Read the responses of a neuron in trials of open sessions, by condition."""
        return compare_responses(self._sessions, trials, train, neuron)

    def overlay_trials(
        self, paths: tuple[str, ...], trials: list[tuple[str, int]], taxel: int, is_ra: bool
    ) -> TrialOverlay:
        """Read trials of sessions of the drum to lay over each other."""
        return overlay_trials(self._sessions, paths, trials, taxel, is_ra)

    def neuron_voltage(
        self, path: str, row: int, taxel: int, first: int, end: int
    ) -> NeuronVoltage:
        """Return v(t) of SA and RA of a taxel in samples of an attempt."""
        voltage_mv = self._sessions.encoded(path, row).voltage_mv(taxel, first, end)
        return NeuronVoltage(taxel, first, voltage_mv)

    def trial_movie(
        self, path: str, row: int, taxel: int, section_s: tuple[float, float], out: str
    ) -> str:
        """Write the movie of a taxel as ``rigctl encode --movie`` does; return its path."""
        session = self._sessions.drum_session(path)
        return write_movie(session, row, taxel, section_s, out, self._progress)

    def verify_session(self, path: str, digest: str) -> AnalysisResults:
        """Check a session as ``rigctl verify`` does; ``digest``: as it was kept, or empty."""
        from rigctl.session.verify import parse_digest, verify

        def show(share: float, what: str) -> None:
            self._progress(what, round(1000 * share), 1000)

        folder = typed_path(path)
        report = verify(folder, show, parse_digest(digest) if digest else "")
        altered = {} if report.whole else self._sessions.altered(path)
        simulated = self._sessions.is_simulated(path)
        return verify_results(report, folder, altered, simulated=simulated)

    def quick_check(self, sessions: tuple[str, ...], figures: str) -> AnalysisResults:
        """Classify textures as the demo does; write the figures into a folder."""
        from rigctl.analysis.report.demo import analyse_sessions

        paths = [Path(session) for session in sessions]
        return quick_results(analyse_sessions(paths, Path(figures), progress=self._progress))

    def analyse(self, options: AnalysisOptions) -> AnalysisResults:
        """Write a report on sessions as ``rigctl analyse`` does."""
        from rigctl.analysis.cache import Cache, Resources, cache_folder
        from rigctl.analysis.report.report_folder import make_report

        now = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
        cache = Cache(cache_folder())
        resources = Resources(cache=cache, progress=self._progress)
        report = make_report(options, now, resources)
        cache.trim()
        return report_results(report)

    def analyse_finger(self, options: AnalysisOptions) -> AnalysisResults:
        """Write a report on the moving finger as ``rigctl analyse --experiment realtime`` does."""
        from rigctl.analysis.cache import Resources

        resources = Resources(progress=self._progress)
        return finger_results(report_on_finger(options, resources))

    def classify(self, model: str, sessions: tuple[str, ...]) -> AnalysisResults:
        """Classify sessions with a trained model as ``rigctl classify`` does."""
        from rigctl.analysis.cache import Resources
        from rigctl.analysis.classify_sessions import classify
        from rigctl.session.model_file import load_model

        loaded = load_model(typed_path(model))
        resources = Resources(progress=self._progress)
        return prediction_results(classify(loaded, tuple(map(Path, sessions)), resources))

    def discard(self, folder: str) -> None:
        """Remove the partial report of a cancelled analysis, whose process could not do so."""
        from rigctl.analysis.files import PARTIAL

        out = Path(folder).absolute()
        shutil.rmtree(out.with_name(PARTIAL.format(name=out.name)), ignore_errors=True)
