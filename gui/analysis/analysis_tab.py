"""The Analysis tab: its panel, the views of its results, and its worker process."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from PySide6.QtCore import QObject, QTimer, Signal
from PySide6.QtWidgets import QWidget

from gui.analysis.export import TABLE, FileSaver, in_process
from gui.analysis.open_sessions import ResponseGrid, write_trial
from gui.analysis.results import AnalysisResults
from gui.analysis.results_view import FigureView, ResultsPanel, ResultsView
from gui.analysis.run_box import MODEL, PAPER, REALTIME
from gui.analysis.session_list import SessionList
from gui.analysis.session_panel import SessionPanel
from gui.analysis.task_values import (
    DRUM,
    FINGER,
    FoundSessions,
    JudgedTrials,
    ScanPicture,
    SessionLines,
    SessionTable,
    describe_options,
    figures_folder,
)
from gui.analysis.trial_overlay import TrialOverlay
from gui.analysis.trial_pages import CourseView, TrialPages
from gui.analysis.trial_sections import finer
from gui.analysis.trial_view import TrialView
from gui.analysis.value_file import write_columns
from gui.analysis.worker import Worker
from gui.widgets.theme import Theme
from gui.widgets.typed_paths import typed_path
from rigctl.errors import WrongUse

FOLLOW_MS = 1000
READING = (
    "open_session",
    "follow_session",
    "load_trial",
    "trial_section",
    "compare_trials",
    "overlay_trials",
    "judge_trials",
    "leave_out",
    "note_trial",
)
"""Tasks of the reader."""
LISTING = ("find_sessions", "read_session_lines")
"""Tasks of the reader for the list of sessions."""


class AnalysisTab(QObject):
    """Runs the panel's requests in worker processes and shows the results.

    ``reader`` opens sessions and reads trials while ``worker`` analyses.
    """

    reported = Signal(str, str)
    """Kind and text for the event log."""
    view_changed = Signal()
    """:attr:`view` has changed."""
    opened = Signal(str)
    """The path of a session that is open now."""
    found_whole = Signal(str)
    """The closing digest of a session that a check found whole."""

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self.panel, self.worker, self.reader = SessionPanel(), Worker(), Worker()
        self._pictures = TemporaryDirectory(prefix="rigctl-scans-")
        self.sessions = SessionList()
        self.trial_view, self.figure_view = TrialPages(theme), FigureView()
        self.results_view, self.files = ResultsView(), FileSaver()
        self.results_panel = ResultsPanel(self.results_view)
        self.author: Callable[[], str] = str
        """Returns who writes notes."""
        self._settings = self._analysed = ""
        self.view: QWidget = self.trial_view
        self._report_folder = self._verified = ""
        self._unverified: list[str] = []
        """Sessions whose check is still to come."""
        self._alarming: tuple[AnalysisResults, str] | None = None
        """What the first check found that was not right, and how it was made."""
        self._is_prepared = False
        self._wanted_trial: tuple[str, int] | None = None
        self._wanted_section: tuple[TrialView | CourseView, dict[str, Any]] | None = None
        """The view and the place of the section that it wants next."""
        self._reads_for: TrialView | CourseView = self.trial_view.readings
        panel, worker, reader = self.panel, self.worker, self.reader
        panel.open_requested.connect(lambda path: reader.submit("open_session", path=path))
        self.sessions.task_requested.connect(lambda task, args: reader.submit(task, **args))
        self.sessions.table_requested.connect(self._write_table)
        panel.trial_requested.connect(self._load_trial)
        panel.note_requested.connect(self._note)
        panel.run_requested.connect(self._run)
        panel.verify_requested.connect(self._verify)
        panel.run_box.cancel_requested.connect(self._cancel)
        panel.run_box.results_requested.connect(lambda: self._show(self.results_panel))
        for save_button in (self.trial_view.save_button, self.results_view.save_button):
            save_button.export_requested.connect(self.save_page)
        self.files.saved.connect(lambda path: self.reported.emit("analysis", f"saved {path}"))
        self.files.failed.connect(lambda text: self.reported.emit("refused", text))
        for view in (self.trial_view.readings, self.trial_view.course):
            view.section_requested.connect(partial(self._want_section, view))
        self.trial_view.compare.compare_requested.connect(self._compare)
        self.trial_view.compare.overlay_requested.connect(self._lay_over)
        self.trial_view.quality.shown.connect(self._judge)
        self.results_panel.refused.connect(lambda text: self.reported.emit("refused", text))
        panel.shown.connect(self.prepare)
        worker.progressed.connect(panel.run_box.show_progress)
        for process in (worker, reader):
            process.finished.connect(self._finish)
            process.failed.connect(self._fail)
        self._follow_timer = QTimer(self, interval=FOLLOW_MS)
        self._follow_timer.timeout.connect(self._follow)
        self._follow_timer.start()

    def open_session(self, path: str) -> None:
        """Open a session, as if the user had chosen its folder."""
        self.panel.open_session(path)

    def lay_over(self, paths: tuple[str, ...]) -> None:
        """Open sessions and show a trial of the condition that most have over each other."""
        self.panel.open_session(paths[0])
        for path in paths[1:]:
            self.panel.run_box.form.add_session(path)
        self.reader.submit("overlay_trials", paths=paths, trials=[], taxel=0, is_ra=False)

    def prepare(self) -> None:
        """Start the reader before it is needed: the first session then opens sooner."""
        if not self._is_prepared:
            self._is_prepared = True
            self.reader.submit("prepare")

    def close(self) -> None:
        """End both worker processes."""
        self._follow_timer.stop()
        self.files.close()
        self.worker.close()
        self.reader.close()
        self._pictures.cleanup()

    def set_theme(self, theme: Theme) -> None:
        """Apply a theme to the views."""
        self.trial_view.set_theme(theme)
        self.results_view.set_theme(theme)

    @property
    def pages(self) -> dict[str, QWidget]:
        """All pages that the middle of the window can show, by their names there."""
        return {
            "trial": self.trial_view,
            "figure": self.figure_view,
            "results": self.results_panel,
            "sessions": self.sessions,
        }

    def _run(self, method: str, path: str) -> None:
        run_box = self.panel.run_box
        try:
            place = run_box.place_of(path)
        except WrongUse as error:
            run_box.show_refusal(f"Results in: {error}")
            return
        self.panel.show_busy()
        self._analysed = path
        if method == PAPER:
            options = run_box.form.options(place)
            self._report_folder = str(options.out)
            self._settings = describe_options(options, DRUM)
            self.worker.submit("analyse", options=options)
        elif method == REALTIME:
            options = run_box.form.options(place)
            self._report_folder = str(options.out)
            self._settings = describe_options(options, FINGER)
            self.worker.submit("analyse_finger", options=options)
        elif method == MODEL:
            sessions = run_box.form.sessions
            names = ", ".join(Path(session).name for session in sessions)
            self._settings = f"Sessions: {names}; model: {run_box.model.text()}"
            self.worker.submit("classify", model=run_box.model.text(), sessions=sessions)
        else:
            sessions = run_box.form.sessions
            names = ", ".join(sessions)
            plural = "s" if len(sessions) > 1 else ""
            self._settings = f"Session{plural}: {names}; {run_box.description.text()}"
            figures = figures_folder(place, path)
            self.worker.submit("quick_check", sessions=sessions, figures=figures)

    def _verify(self, path: str, digest: str) -> None:
        """Check all sessions that are open, one after the other; the digest is the first one's."""
        self._alarming = None
        self._unverified = [other for other in self.panel.sessions if other != path]
        self._verify_one(path, digest)

    def _verify_one(self, path: str, digest: str = "") -> None:
        self.panel.show_busy()
        kept = "with the digest that was kept" if digest else "without a kept digest"
        self._settings = f"Session: {path}; {kept}"
        self._verified = self._analysed = path
        self.worker.submit("verify_session", path=path, digest=digest)

    def _note(self, path: str, row: int, text: str, mark: str) -> None:
        note = {"text": text, "author": self.author(), "mark": mark}
        self.reader.submit("note_trial", path=path, row=row, **note)

    def _load_trial(self, path: str, row: int) -> None:
        """Read a trial; of several that were chosen quickly, only the last one is shown."""
        self._wanted_trial = path, row
        if not self.reader.is_busy:
            self._read_wanted()

    def _read_wanted(self) -> None:
        if self._wanted_trial is not None:
            (path, row), self._wanted_trial = self._wanted_trial, None
            self.reader.submit("load_trial", path=path, row=row, pictures=self._pictures.name)
        elif self._wanted_section is not None:
            (self._reads_for, place), self._wanted_section = self._wanted_section, None
            self.reader.submit("trial_section", **place)

    def _want_section(
        self, view: TrialView | CourseView, first: int, end: int, factor: int
    ) -> None:
        """Read a part of the trial that is shown; of several wishes, only the last one."""
        assert self.trial_view.data is not None
        path, row = self.trial_view.data.place
        place = {"path": path, "row": row, "first": first, "end": end, "factor": finer(factor)}
        self._wanted_section = view, place
        if not self.reader.is_busy:
            self._read_wanted()

    def save_page(self, suffix: str) -> None:
        """Save the page in front as a new file beside the session that it is about."""
        if self.view is self.results_panel and self.results_view.count():
            self._save_results(suffix)
        elif self.view is self.trial_view and self.trial_view.data is not None:
            self._save_trial(suffix)
        else:
            self.reported.emit("refused", "there is no page to save: choose a trial first")

    def _save_trial(self, suffix: str) -> None:
        pages, folder = self.trial_view, self._figures_of(self.panel.path)
        stem = pages.file_stem()
        if suffix != TABLE:
            self.files.save(folder, stem, suffix, pages.picture())
        elif (recorded := pages.recorded_values()) is not None:
            self.files.save(folder, stem, suffix, in_process(write_trial, *recorded))
        else:
            self.files.save(folder, stem, suffix, in_process(write_columns, *pages.values()))

    def _save_results(self, suffix: str) -> None:
        view = self.results_view
        place = (self._figures_of(self._analysed), view.file_stem(), suffix)
        if suffix == TABLE:
            self.files.save(*place, view.csv().encode())
        elif view.isVisible() and not view.is_whole:  # what is missing has its own turns
            QTimer.singleShot(0, self, lambda: self._save_results(suffix))
        else:
            self.files.save(*place, view.picture())

    def _write_table(self, session: str) -> None:
        """Write all attempts of a session with their notes as a table."""
        from rigctl.session.trial_csv import write_trials

        write = in_process(write_trials, typed_path(session))
        self.files.save(self._figures_of(session), "trials", TABLE, write)

    def _figures_of(self, session: str) -> str:
        """Return the folder for saved pages; what is no whole path, for the saver to refuse."""
        try:
            return figures_folder(self.panel.run_box.place_of(session), session)
        except WrongUse:
            return self.panel.run_box.place.text()

    def _keep_verified(self) -> None:
        table = self.panel.sessions.get(self._verified)
        if table is not None and table.closing_digest:
            self.found_whole.emit(table.closing_digest)

    def _compare(self, train: int, neuron: str) -> None:
        trials = self.panel.compared_trials()
        self.reader.submit("compare_trials", trials=trials, train=train, neuron=neuron)

    def _lay_over(self, taxel: int, is_ra: bool) -> None:
        paths, trials = tuple(self.panel.sessions), self.panel.selected_trials()
        self.reader.submit("overlay_trials", paths=paths, trials=trials, taxel=taxel, is_ra=is_ra)

    def _judge(self) -> None:
        """Judge the trials of the session of the trial that is shown, if it is of the drum."""
        if self.trial_view.data is not None:
            self.reader.submit("judge_trials", path=self.trial_view.data.place[0])

    def _follow(self) -> None:
        """Read what was recorded since the last time."""
        if not self.reader.is_busy:
            for path in self.panel.growing:
                self.reader.submit("follow_session", path=path)

    def _cancel(self) -> None:
        self.worker.cancel()
        self._unverified = []
        self.panel.show_idle()
        if self._report_folder:
            self.worker.submit("discard", folder=self._report_folder)
        self._report_folder = ""
        self.reported.emit("analysis", "analysis cancelled")

    def _finish(self, task: str, result: Any) -> None:
        if task == "prepare" and not self.reader.is_busy:
            self.reader.submit("load_encoder")  # after a session that is wanted already
        elif isinstance(result, ResponseGrid):
            self.trial_view.compare.show_grid(result)
        elif isinstance(result, TrialOverlay):
            self._show_overlay(result)
        elif isinstance(result, JudgedTrials):
            self.trial_view.quality.show_judged(result)
        elif isinstance(result, SessionTable):
            self.panel.show_session(result)
            if task == "open_session":
                self.opened.emit(result.path)
            if task == "note_trial" and self.panel.trials.chosen is not None:
                _, row = self.panel.trials.chosen
                self._load_trial(result.path, row)
        elif isinstance(result, FoundSessions):
            self.sessions.show_found(result.paths)
        elif isinstance(result, SessionLines):
            self.sessions.show_lines(result.lines)
        elif isinstance(result, ScanPicture):
            self.figure_view.show_file(result.figure)
            self._show(self.figure_view)
        elif task == "trial_section":
            self._reads_for.show_section(result)
        elif task == "load_trial":
            self._wanted_section = None
            self.trial_view.show_trial(result)
            self._show(self.trial_view)
        elif isinstance(result, AnalysisResults):
            self._report_folder = ""
            if task == "verify_session" and not result.is_alarming:
                self._keep_verified()
            if result.altered and self._verified in self.panel.sessions:
                self.reader.submit("leave_out", path=self._verified, altered=result.altered)
            self.reported.emit("check" if result.is_alarming else "analysis", result.sentence)
            self._show_results(task, result)
        if not self.reader.is_busy:
            self._read_wanted()
        quality = self.trial_view.quality
        has_more = quality.is_behind or (task == "follow_session" and result is not None)
        if has_more and quality.isVisible() and not self.reader.is_busy:
            self._judge()

    def _show_overlay(self, overlay: TrialOverlay) -> None:
        pages = self.trial_view
        pages.compare.show_overlay(overlay)
        pages.setCurrentWidget(pages.compare)
        self._show(pages)

    def _show_results(self, task: str, result: AnalysisResults) -> None:
        """Show results; of several checks the first that found something, when all are done."""
        found = result, self._settings
        if task == "verify_session":
            if result.is_alarming and self._alarming is None:
                self._alarming = found
            if self._unverified:
                self._verify_one(self._unverified.pop(0))
                return
            found = self._alarming or found
        result, settings = found
        self.results_panel.show_results(result, settings)
        self.panel.show_result(result.sentence, is_alarming=result.is_alarming)
        self._show(self.results_panel)

    def _fail(self, task: str, sentence: str) -> None:
        is_first = len(self.panel.run_box.form.sessions) < 2
        if task in LISTING:
            self.sessions.show_failure(sentence)
        elif task == "open_session" and is_first:
            self.panel.show_unopened(sentence)
        elif task in READING:
            self.panel.drop_unopened()
            self.panel.run_box.show_refusal(sentence)
        else:
            self._report_folder, self._unverified = "", []
            self.panel.show_failure(sentence)
        if task == "load_trial" or (task == "open_session" and is_first):
            self.trial_view.show_trial(None)
            self._show(self.trial_view)
        self.reported.emit("refused", sentence)

    def _show(self, view: QWidget) -> None:
        self.view = view
        self.view_changed.emit()
