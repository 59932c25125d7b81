"""Keeps the learning curve up to date: a worker process computes it while the tab is shown."""

from __future__ import annotations

from typing import Any

from PySide6.QtCore import QObject, Signal

from gui.analysis.export.export_button import TABLE
from gui.analysis.export.picture_encoder import NewFile, PictureEncoder
from gui.analysis.export.picture_file import widget_picture
from gui.analysis.tasks.worker import Worker
from gui.protocol.learning.curve_texts import VALUE_NAMES, values
from gui.protocol.learning.learning_page import (
    FAILED,
    NO_SESSION,
    NO_TRIAL,
    LearningPage,
)
from gui.widgets.typed_paths import typed_path

CURVE = "learning_curve"
Stage = tuple[str, int, int]
"""A session's folder, its trials that count, and all attempts: what changes the curve."""
STEM = "learning-curve"
"""Name of a saved file."""


class LearningLink(QObject):
    """Asks for a curve whenever the session of the page has got further.

    It has a process of its own, so that neither the trial table nor an analysis waits for it.
    """

    reported = Signal(str, str)

    def __init__(self, page: LearningPage) -> None:
        super().__init__()
        self.worker, self.encoder = Worker(), PictureEncoder()
        self._page = page
        self._stage: Stage = ("", 0, 0)
        self._computed: Stage | None = None
        self._is_cancelled = False
        page.shown.connect(self.submit)
        page.pressed.connect(self._press)
        page.export_requested.connect(self._export)
        self.encoder.encoded.connect(self._write_file)
        self.encoder.failed.connect(lambda text: self.reported.emit("refused", text))
        self.worker.progressed.connect(page.show_progress)
        self.worker.finished.connect(self._finish)
        self.worker.failed.connect(self._fail)

    def show_session(self, folder: str, committed: int, attempts: int) -> None:
        """Take note of how far the session of the page is."""
        stage = folder, committed, attempts
        if stage == self._stage:
            return
        if folder != self._stage[0]:
            self._leave(folder)
        self._stage = stage
        self.submit()

    def submit(self) -> None:
        """Ask for the curve, if it is looked at and the process is free."""
        folder, committed, _ = self._stage
        is_due = self._computed != self._stage and committed > 0 and not self._is_cancelled
        if not is_due or self.worker.is_busy or not self._page.isVisible():
            return
        self._computed = self._stage
        self._page.show_computing()
        self.worker.submit(CURVE, folder=folder)

    def close(self) -> None:
        """End the worker process and what is being saved, as before the window closes."""
        self.encoder.wait()
        self.worker.cancel()

    def _leave(self, folder: str) -> None:
        """Show another session, and end what is computed for the one before."""
        if self.worker.is_busy:
            self.worker.cancel()
        self._computed, self._is_cancelled = None, False
        self._page.show_idle()
        self._page.show_text(NO_TRIAL if folder else NO_SESSION)

    def _press(self) -> None:
        if self.worker.is_busy:
            self.worker.cancel()
            self._is_cancelled = True
            self._page.show_cancelled()
            return
        self._is_cancelled, self._computed = False, None
        self.submit()

    def _finish(self, task: str, result: Any) -> None:
        if task == CURVE and result.folder == self._stage[0]:
            self._page.show_curve(result)
            self._page.show_idle()
        elif task != CURVE:
            self.reported.emit("analysis", f"saved {result}")
        self.submit()

    def _fail(self, task: str, sentence: str) -> None:
        if task == CURVE:
            self._page.show_idle(FAILED)
            self._page.show_text(sentence)
        else:
            self.reported.emit("refused", sentence)

    def _export(self, suffix: str) -> None:
        """Save the curve beside its session."""
        curve = self._page.curve
        if curve is None:
            return
        session = typed_path(curve.folder).absolute()
        stem = f"{STEM}-simulated" if curve.simulated else STEM
        file = NewFile(f"{session}-figures", stem, suffix)
        if suffix == TABLE:
            table = {"names": VALUE_NAMES, "columns": values(curve)}
            self.worker.submit("save_values", folder=file.folder, stem=stem, **table)
        else:
            self.encoder.encode(widget_picture(self._page.figure), file)

    def _write_file(self, file: NewFile, content: bytes) -> None:
        self.worker.submit("save_file", **file._asdict(), content=content)
