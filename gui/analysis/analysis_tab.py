"""The Analysis tab: its panel, the views of its results, and its worker process."""

from __future__ import annotations

from typing import Any

from PySide6.QtCore import QObject, Signal
from PySide6.QtWidgets import QWidget

from gui.analysis.results import AnalysisResults
from gui.analysis.results_view import FigureView, ResultsView
from gui.analysis.run_box import MODEL, PAPER, REALTIME
from gui.analysis.session_panel import SessionPanel
from gui.analysis.task_values import QuickCheckResult, ScanPicture
from gui.analysis.trial_view import TrialView
from gui.analysis.worker import Worker
from gui.widgets.theme import Theme


class AnalysisTab(QObject):
    """Runs the panel's requests in the worker process and shows the results."""

    reported = Signal(str, str)
    """Kind and text for the event log."""
    view_changed = Signal()
    """:attr:`view` has changed."""

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self.panel, self.worker = SessionPanel(), Worker()
        self.trial_view, self.figure_view = TrialView(theme), FigureView()
        self.results_view = ResultsView(documentMode=True)
        self.view: QWidget = self.trial_view
        self._last_results: QWidget = self.figure_view
        self._report_folder = ""
        panel, worker = self.panel, self.worker
        panel.open_requested.connect(lambda path: worker.submit("open_session", path=path))
        panel.trial_requested.connect(lambda row: worker.submit("load_trial", row=row))
        panel.run_requested.connect(self._run)
        panel.run_box.cancel_requested.connect(self._cancel)
        panel.run_box.results_requested.connect(lambda: self._show(self._last_results))
        worker.finished.connect(self._finish)
        worker.progressed.connect(panel.run_box.show_progress)
        worker.failed.connect(lambda _, sentence: self._fail(sentence))

    @property
    def views(self) -> tuple[QWidget, ...]:
        """Return all views that the middle of the window can show."""
        return self.trial_view, self.figure_view, self.results_view

    def _run(self, method: str, path: str) -> None:
        run_box = self.panel.run_box
        self.panel.show_busy()
        if method == PAPER:
            request = run_box.form.request()
            self._report_folder = request.folder
            self.worker.submit("analyse", request=request)
        elif method == REALTIME:
            request = run_box.form.request()
            self._report_folder = request.folder
            self.worker.submit("analyse_finger", request=request)
        elif method == MODEL:
            sessions = run_box.form.sessions
            self.worker.submit("classify", model=run_box.model.text(), sessions=sessions)
        else:
            self.worker.submit("quick_check", path=path)

    def _cancel(self) -> None:
        self.worker.cancel()
        self.panel.show_idle()
        if self._report_folder:
            self.worker.submit("discard", folder=self._report_folder)
        self._report_folder = ""
        self.reported.emit("analysis", "analysis cancelled")

    def _finish(self, task: str, result: Any) -> None:
        if task == "open_session":
            self.panel.show_session(result)
        elif isinstance(result, ScanPicture):
            self.figure_view.show_file(result.figure)
            self._show(self.figure_view)
        elif task == "load_trial":
            self.trial_view.show_trial(result)
            self._show(self.trial_view)
        elif isinstance(result, QuickCheckResult):
            self.figure_view.show_file(result.figure)
            self._show_results(result.sentence, self.figure_view)
        elif isinstance(result, AnalysisResults):
            self._report_folder = ""
            self.results_view.show_results(result)
            self._show_results(result.sentence, self.results_view)

    def _fail(self, sentence: str) -> None:
        self._report_folder = ""
        self.panel.show_failure(sentence)
        self.reported.emit("refused", sentence)

    def _show_results(self, sentence: str, view: QWidget) -> None:
        self.panel.show_result(sentence)
        self._last_results = view
        self._show(view)
        self.reported.emit("analysis", sentence)

    def _show(self, view: QWidget) -> None:
        self.view = view
        self.view_changed.emit()
