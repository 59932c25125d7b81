"""Choosing a protocol, seeing what it asks for, starting it and watching it go."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtCore import QDateTime, QSignalBlocker, Qt, Signal
from PySide6.QtGui import QShowEvent
from PySide6.QtWidgets import (
    QComboBox,
    QFormLayout,
    QGridLayout,
    QGroupBox,
    QHBoxLayout,
    QLineEdit,
    QProgressBar,
    QPushButton,
    QSpinBox,
    QVBoxLayout,
    QWidget,
)

from gui.analysis.worker_tasks import Summary
from gui.widgets.formatting import duration
from gui.widgets.labels import elastic, label, set_property, show_text
from rigctl.acquisition.rpc.messages import EngineStatus, RunStatus
from rigctl.config import resources

MAX_SEED = 2**31 - 1


class ProtocolPanel(QWidget):
    """Emits what is asked for; a running protocol is shown from the engine's status alone."""

    start_asked = Signal(str, str, int)
    asked = Signal(str)
    summary_asked = Signal(str, object)
    session_asked = Signal()
    file_asked = Signal()
    folder_asked = Signal()

    def __init__(self) -> None:
        super().__init__()
        self.choice = QComboBox()
        self.out = QLineEdit(str(Path.home() / "rigctl-sessions"))
        self.out.setToolTip("A new folder is made in here for every session")
        self.seed = QSpinBox()
        self.seed.setRange(0, MAX_SEED)
        self.seed.setToolTip("Decides the order of shuffled trials; stored with the session")
        self.summary = {name: label("–") for name in ("Trials", "Plate changes", "Time", "Disk")}
        self.problem = label("", "bad", wraps=True)
        self.buttons = {name: QPushButton(name) for name in ("Start", "Pause", "Resume", "Abort")}
        self.go_on = QPushButton("Continue a session …")
        self.go_on.setToolTip("Run the trials that an interrupted session still lacks")
        self.bar = QProgressBar()
        self.bar.setTextVisible(True)
        self.lines = {name: elastic(label("–")) for name in _LINES}
        self.state = label("No run", "heading", wraps=True)
        self._startable = False
        self._lay_out()
        self._connect()
        self.show_protocols()
        self.show_status(EngineStatus())

    def show_protocols(self) -> None:
        """List the protocols that come with the program; the quick one first."""
        paths = resources.protocols().glob("*.toml")
        self.choice.clear()
        for path in sorted(paths, key=lambda path: (path.stem != "quick", path.stem)):
            self.choice.addItem(path.stem, str(path))
            self.choice.setItemData(self.choice.count() - 1, str(path), Qt.ItemDataRole.ToolTipRole)

    def add_protocol(self, path: str) -> None:
        """Offer a file and choose it."""
        if self.choice.findData(path) < 0:
            self.choice.addItem(Path(path).name, path)
        self.choice.setCurrentIndex(self.choice.findData(path))

    def set_out(self, folder: str) -> None:
        """Put sessions into another folder."""
        self.out.setText(folder)

    def show_status(self, status: EngineStatus) -> None:
        """Buttons by what is possible, progress as the engine counts it."""
        run = status.run
        ready = status.drum_connected and status.taxels_connected and not status.fault
        self.buttons["Start"].setEnabled(self._startable and ready and not run.is_active)
        self.go_on.setEnabled(ready and not run.is_active)
        self.buttons["Pause"].setEnabled(run.state == "running")
        self.buttons["Resume"].setEnabled(run.state == "paused")
        self.buttons["Abort"].setEnabled(run.is_active)
        for widget in (self.choice, self.out, self.seed, self._open, self._browse):
            widget.setEnabled(not run.is_active)
        self._show_progress(run)

    def _show_progress(self, run: RunStatus) -> None:
        show_text(self.state, run_sentence(run))
        set_property(self.state, "role", "bad" if run.state == "failed" else "heading")
        self.bar.setMaximum(max(run.trials_planned, 1))
        self.bar.setValue(run.trials_committed)
        self.bar.setFormat("%p %")
        left = f", {duration(run.eta_s)} left" if run.is_active and run.eta_s is not None else ""
        planned = f"{run.trials_committed} of {run.trials_planned} trials{left}"
        show_text(self.lines["Progress"], planned if run.trials_planned else "–")
        show_text(self.lines["Now"], trial_words(run))
        show_text(self.lines["Rejected"], f"{run.trials_rejected}" if run.trials_planned else "–")
        self.lines["Session"].setText(Path(run.session).name if run.session else "–")
        self.lines["Session"].setToolTip(run.session or "")

    def show_summary(self, found: Summary) -> None:
        """What the chosen protocol asks for."""
        for made, text in zip(self.summary.values(), found[:4], strict=True):
            made.setText(text)
        self.problem.setText(found.problem)
        self.problem.setVisible(bool(found.problem))
        self._startable = not found.problem
        with QSignalBlocker(self.seed):
            self.seed.setValue(found.seed)

    def showEvent(self, event: QShowEvent) -> None:
        """Plan the protocol when it can be seen for the first time."""
        super().showEvent(event)
        if not self._startable and not self.problem.text():
            self._choose()

    def _choose(self, seed: int | None = None) -> None:
        """Ask for a summary; until it is there nothing can be started."""
        self._startable = False
        if path := self.choice.currentData():
            self.summary_asked.emit(path, seed)

    def _start(self) -> None:
        stamp = QDateTime.currentDateTimeUtc().toString("yyyyMMdd-HHmmss")
        folder = (
            Path(self.out.text()).expanduser() / f"{Path(self.choice.currentText()).stem}-{stamp}"
        )
        self.start_asked.emit(self.choice.currentData(), str(folder), self.seed.value())

    def _connect(self) -> None:
        self.choice.currentIndexChanged.connect(lambda _: self._choose())
        self.seed.valueChanged.connect(self._choose)
        self._open.clicked.connect(self.file_asked)
        self._browse.clicked.connect(self.folder_asked)
        self.buttons["Start"].clicked.connect(self._start)
        self.go_on.clicked.connect(self.session_asked)
        for name in ("Pause", "Resume", "Abort"):
            self.buttons[name].clicked.connect(lambda _=False, n=name: self.asked.emit(n.lower()))

    def _lay_out(self) -> None:
        column = QVBoxLayout(self)
        column.setContentsMargins(6, 4, 6, 6)
        column.setSpacing(4)
        column.addWidget(self._choice_box())
        column.addWidget(self._run_box())
        column.addStretch(1)

    def _choice_box(self) -> QGroupBox:
        self._open, self._browse = _small("Open another protocol"), _small("Choose another folder")
        box = QGroupBox("Protocol")
        form = QFormLayout(box)
        form.setContentsMargins(8, 6, 8, 8)
        form.setVerticalSpacing(5)
        form.setFieldGrowthPolicy(QFormLayout.FieldGrowthPolicy.ExpandingFieldsGrow)
        form.addRow("File", _beside(self.choice, self._open))
        form.addRow("Save in", _beside(self.out, self._browse))
        form.addRow("Seed", self.seed)
        for name, shown in self.summary.items():
            form.addRow(label(name, "muted"), shown)
        form.addRow(self.problem)
        return box

    def _run_box(self) -> QGroupBox:
        box = QGroupBox("Run")
        column = QVBoxLayout(box)
        column.setContentsMargins(8, 6, 8, 8)
        grid = QGridLayout()
        for place, button in enumerate(self.buttons.values()):
            grid.addWidget(button, place // 2, place % 2)
        grid.addWidget(self.go_on, 2, 0, 1, 2)
        column.addLayout(grid)
        column.addWidget(self.state)
        column.addWidget(self.bar)
        form = QFormLayout()
        form.setVerticalSpacing(3)
        for name, shown in self.lines.items():
            form.addRow(label(name, "muted"), shown)
        column.addLayout(form)
        return box


_LINES = ("Progress", "Now", "Rejected", "Session")
_STATES = {
    "idle": "No run",
    "running": "Running",
    "prompt": "Waiting for you: answer above",
    "paused": "Paused, lifted",
    "done": "Done: every trial is on disk",
    "aborted": "Aborted: what was committed is kept",
    "failed": "Failed: what was committed is kept",
}


def run_sentence(run: RunStatus) -> str:
    """How the run stands, with the reasons of a pause."""
    if run.text:
        return run.text
    words = _STATES.get(run.state, run.state)
    return f"{words} ({', '.join(run.reasons)})" if run.reasons else words


def trial_words(run: RunStatus) -> str:
    """The trial that runs now."""
    if not run.current:
        return "–"
    now = run.current
    return (
        f"#{run.trial_id or 0}: {now.texture}, {now.speed_mm_s:g} mm/s, "
        f"{now.force_g:g} g, repeat {now.repeat}"
    )


def _small(hint: str) -> QPushButton:
    button = QPushButton("…")
    button.setFixedWidth(34)
    button.setToolTip(hint)
    return button


def _beside(wide: QWidget, narrow: QWidget) -> QHBoxLayout:
    row = QHBoxLayout()
    row.setSpacing(4)
    row.addWidget(wide, 1)
    row.addWidget(narrow)
    return row
