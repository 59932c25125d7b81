"""Planning of protocols in a worker process: the paper's 24,000 trials take seconds."""

from __future__ import annotations

from PySide6.QtCore import QObject, Signal

from gui.analysis.worker import Worker
from gui.analysis.worker_tasks import PlanSummary


class Planner(QObject):
    """Plans the latest requested protocol; a newer request replaces one that waits."""

    planned = Signal(object)
    """The :class:`PlanSummary` of the latest request."""

    def __init__(self) -> None:
        super().__init__()
        self.worker = Worker()
        self._next: tuple[str, int | None] | None = None
        self.worker.finished.connect(lambda _, summary: self._finish(summary))
        self.worker.failed.connect(lambda _, sentence: self._finish(PlanSummary(problem=sentence)))

    def request(self, path: str, seed: int | None) -> None:
        """Plan the protocol of a file; without a seed, with its own."""
        self._next = (path, seed)
        self._submit()

    def _submit(self) -> None:
        if self._next is None or self.worker.is_busy:
            return
        (path, seed), self._next = self._next, None
        self.worker.submit("plan_protocol", path=path, seed=seed)

    def _finish(self, summary: PlanSummary) -> None:
        if self._next is None:
            self.planned.emit(summary)
        self._submit()
