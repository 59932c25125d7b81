"""Write movies of a replay in a process of its own: kind, length, progress, cancel."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtCore import QObject, Signal
from PySide6.QtWidgets import QComboBox, QWidget

from gui.analysis.tasks.worker import Worker
from gui.widgets.labels import label
from gui.widgets.layouts import push_button
from gui.widgets.number_box import NumberBox, has_refused
from gui.widgets.typed_paths import typed_path
from rigctl.analysis.files import PARTIAL

LONGEST_S = 10.0
MOVIE, CANCEL = "Movie", "Cancel"
TIP = "Write the time before this moment of the chosen taxel beside the session"


class MovieMaker(QObject):
    """The controls of movies; ``button`` starts one and cancels it while it is drawn."""

    requested = Signal()
    """The button, while no movie is drawn."""
    told = Signal(str)
    """What happens, in words."""
    saved = Signal(str)
    """The path of a whole movie."""
    failed = Signal(str)
    """One sentence."""

    def __init__(self) -> None:
        super().__init__()
        self.kind = QComboBox()
        for name, end in (("GIF", ".gif"), ("MP4", ".mp4")):
            self.kind.addItem(name, end)
        self.kind.setToolTip("Kind of the movie; an MP4 needs ffmpeg on this computer")
        self.length = NumberBox(minimum=0.1, maximum=LONGEST_S, value=1.0, decimals=1)
        self.length.setSuffix(" s")
        self.length.setToolTip("How much of the trial the movie shows")
        self.button = push_button(MOVIE, self._click, TIP)
        self._out: Path | None = None
        self.worker = Worker()
        self.worker.progressed.connect(lambda stage, share: self.told.emit(f"{stage}: {share:.0%}"))
        self.worker.finished.connect(lambda _, path: self._end(path))
        self.worker.failed.connect(lambda _, sentence: self._fail(sentence))

    @property
    def controls(self) -> tuple[QWidget, ...]:
        """Length, kind and button, each with its label."""
        return label("Last"), self.length, label("as"), self.kind, self.button

    def write(self, session: str, row: int, taxel: int, end_s: float) -> None:
        """Draw the time before a moment of an attempt for a taxel; rows and taxels from 0."""
        start_s = max(0.0, end_s - self.length.value())
        folder = typed_path(session)
        name = f"{folder.name}-attempt{row + 1}-T{taxel + 1}-{start_s:.3f}s"
        self._out = out = folder.absolute().with_name(name + self.kind.currentData())
        section_s = (start_s, self.length.value())
        place = {"path": session, "row": row, "taxel": taxel}
        self.worker.submit("trial_movie", **place, section_s=section_s, out=str(out))
        self.button.setText(CANCEL)
        self.told.emit(f"drawing {out} …")

    def cancel(self) -> None:
        """End the drawing; no movie is left."""
        self.worker.cancel()
        self.button.setText(MOVIE)
        if self._out is not None:
            # The process had no time to remove what it had drawn.
            self._out.with_name(PARTIAL.format(name=self._out.name)).unlink(missing_ok=True)
            self._out = None

    def _click(self) -> None:
        if self.worker.is_busy:
            self.cancel()
            self.told.emit("The movie is cancelled.")
        elif not has_refused(self.length):
            self.requested.emit()

    def _end(self, path: str) -> None:
        self._out = None
        self.button.setText(MOVIE)
        self.saved.emit(path)

    def _fail(self, sentence: str) -> None:
        self._out = None
        self.button.setText(MOVIE)
        self.failed.emit(sentence)
