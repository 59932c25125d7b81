"""The Analysis tab at work: its panel, its pages, and the process that reads and reckons."""

from __future__ import annotations

from typing import Any

from PySide6.QtCore import QObject, Signal

from gui.analysis_panel import AnalysisPanel
from gui.figure_view import FigureView
from gui.theme import Theme
from gui.trial_view import TrialView
from gui.worker import Worker


class AnalysisDesk(QObject):
    """``said``: a kind and a sentence for the log. ``page_changed``: show :attr:`page`."""

    said = Signal(str, str)
    page_changed = Signal()

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self.panel, self.worker = AnalysisPanel(), Worker()
        self.trial_view, self.figure = TrialView(theme), FigureView()
        self.page: TrialView | FigureView = self.trial_view
        panel, worker = self.panel, self.worker
        panel.open_asked.connect(lambda path: worker.ask("open_session", path=path))
        panel.trial_asked.connect(lambda row: worker.ask("load_trial", row=row))
        panel.classify_asked.connect(self._classify)
        panel.cancel_asked.connect(self._cancel)
        panel.figure_asked.connect(lambda: self._show(self.figure))
        worker.done.connect(self._done)
        worker.progressed.connect(panel.show_progress)
        worker.failed.connect(lambda _, sentence: self._failed(sentence))

    def _classify(self, path: str) -> None:
        self.panel.show_busy()
        self.worker.ask("classify", path=path)

    def _cancel(self) -> None:
        self.worker.cancel()
        self.panel.show_idle()
        self.said.emit("analysis", "classification cancelled")

    def _done(self, task: str, result: Any) -> None:
        if task == "open_session":
            self.panel.show_session(result)
        elif task == "load_trial":
            self.trial_view.show_trial(result)
            self._show(self.trial_view)
        else:
            self.panel.show_classified(result)
            self.figure.show_file(result.figure)
            self._show(self.figure)
            self.said.emit("analysis", result.sentence)

    def _failed(self, sentence: str) -> None:
        self.panel.show_failure(sentence)
        self.said.emit("refused", sentence)

    def _show(self, page: TrialView | FigureView) -> None:
        self.page = page
        self.page_changed.emit()
