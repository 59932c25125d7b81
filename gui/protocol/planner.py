"""Planning protocols in a process of its own: the paper's 24,000 trials take seconds."""

from __future__ import annotations

from PySide6.QtCore import QObject

from gui.analysis.worker import Worker
from gui.analysis.worker_tasks import Summary
from gui.protocol.protocol_panel import ProtocolPanel


class Planner(QObject):
    """Answers the panel's last question; earlier ones that wait are forgotten."""

    def __init__(self, panel: ProtocolPanel) -> None:
        super().__init__()
        self.worker = Worker()
        self._panel = panel
        self._wanted: tuple[str, int | None] | None = None
        panel.summary_asked.connect(self._ask)
        self.worker.done.connect(lambda _, summary: self._show(summary))
        self.worker.failed.connect(lambda _, sentence: self._show(Summary(problem=sentence)))

    def _ask(self, path: str, seed: int | None) -> None:
        self._wanted = (path, seed)
        self._next()

    def _next(self) -> None:
        if self._wanted is None or self.worker.is_busy:
            return
        (path, seed), self._wanted = self._wanted, None
        self.worker.ask("summarise", path=path, seed=seed)

    def _show(self, summary: Summary) -> None:
        if self._wanted is None:
            self._panel.show_summary(summary)
        self._next()
