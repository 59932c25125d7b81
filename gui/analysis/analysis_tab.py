"""The Analysis tab at work: its panel, its pages, and the process that reads and reckons."""

from __future__ import annotations

from typing import Any

from PySide6.QtCore import QObject, Signal
from PySide6.QtWidgets import QWidget

from gui.analysis.results import AnalysisResults
from gui.analysis.results_view import ResultsView
from gui.analysis.run_box import MODEL, PAPER
from gui.analysis.session_panel import SessionPanel
from gui.analysis.trial_view import TrialView
from gui.analysis.worker import Worker
from gui.analysis.worker_tasks import Classified
from gui.widgets.figure_view import FigureView
from gui.widgets.theme import Theme


class AnalysisTab(QObject):
    """``said``: a kind and a sentence for the log. ``page_changed``: show :attr:`page`."""

    said = Signal(str, str)
    page_changed = Signal()

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self.panel, self.worker = SessionPanel(), Worker()
        self.trial_view, self.figure = TrialView(theme), FigureView()
        self.findings = ResultsView()
        self.page: QWidget = self.trial_view
        self._results: QWidget = self.figure
        self._making = ""
        panel, worker = self.panel, self.worker
        panel.open_asked.connect(lambda path: worker.ask("open_session", path=path))
        panel.trial_asked.connect(lambda row: worker.ask("load_trial", row=row))
        panel.run_asked.connect(self._run)
        panel.cancel_asked.connect(self._cancel)
        panel.box.results_asked.connect(lambda: self._show(self._results))
        worker.done.connect(self._done)
        worker.progressed.connect(panel.box.show_progress)
        worker.failed.connect(lambda _, sentence: self._failed(sentence))

    @property
    def pages(self) -> tuple[QWidget, ...]:
        """Everything that can stand in the middle of the window."""
        return self.trial_view, self.figure, self.findings

    def _run(self, way: str, path: str) -> None:
        box = self.panel.box
        self.panel.show_busy()
        if way == PAPER:
            order = box.form.order()
            self._making = order.folder
            self.worker.ask("analyse", order=order)
        elif way == MODEL:
            self.worker.ask("ask_model", model=box.model.text(), sessions=box.form.chosen)
        else:
            self.worker.ask("classify", path=path)

    def _cancel(self) -> None:
        self.worker.cancel()
        self.panel.show_idle()
        if self._making:
            self.worker.ask("discard", folder=self._making)
        self._making = ""
        self.said.emit("analysis", "analysis cancelled")

    def _done(self, task: str, result: Any) -> None:
        if task == "open_session":
            self.panel.show_session(result)
        elif task == "load_trial":
            self.trial_view.show_trial(result)
            self._show(self.trial_view)
        elif isinstance(result, Classified):
            self.figure.show_file(result.figure)
            self._answered(result.sentence, self.figure)
        elif isinstance(result, AnalysisResults):
            self._making = ""
            self.findings.show_findings(result)
            self._answered(result.sentence, self.findings)

    def _answered(self, sentence: str, page: QWidget) -> None:
        self.panel.show_answer(sentence)
        self._results = page
        self._show(page)
        self.said.emit("analysis", sentence)

    def _failed(self, sentence: str) -> None:
        self._making = ""
        self.panel.show_failure(sentence)
        self.said.emit("refused", sentence)

    def _show(self, page: QWidget) -> None:
        self.page = page
        self.page_changed.emit()
