"""The Protocol tab: choose a protocol, check its plan, start it and follow the run."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from PySide6.QtCore import QDateTime, QSignalBlocker, Qt, Signal
from PySide6.QtGui import QShowEvent
from PySide6.QtWidgets import (
    QComboBox,
    QGridLayout,
    QGroupBox,
    QLineEdit,
    QProgressBar,
    QSpinBox,
    QVBoxLayout,
    QWidget,
)

from gui.analysis.task_values import PLAN_ROWS, PlanSummary
from gui.analysis.worker import Worker
from gui.widgets.file_browser import PathKind, browse_button
from gui.widgets.formatting import duration
from gui.widgets.labels import elastic, label, plain_tooltip, set_property, show_text
from gui.widgets.layouts import form_layout, group_box, hbox, push_button, vbox
from rigctl.acquisition.rpc.messages import EngineStatus, RunStatus
from rigctl.config import resources

MAX_SEED = 2**31 - 1
_RUN_ROWS = ("Progress", "Trial", "Rejected", "Session")
_MOVED_BY_HAND = "The drum is moved by hand: wait until that has ended, or press STOP"
_STATES = {
    "idle": "No run",
    "running": "Running",
    "prompt": "Waiting for your answer above",
    "paused": "Paused, drum lifted",
    "done": "Done: all trials are on disk",
    "aborted": "Aborted: committed trials are kept",
    "failed": "Failed: committed trials are kept",
}


class ProtocolPanel(QWidget):
    """Controls for protocols; emits engine commands, and shows the run that the engine reports."""

    command_requested = Signal(str, dict)
    path_requested = Signal(object, object)

    def __init__(self) -> None:
        super().__init__()
        self.worker = Worker()
        """Plans the protocol: the paper's 24,000 trials take seconds."""
        self._next_plan: tuple[str, int | None] | None = None
        self.protocol = QComboBox()
        self.out = QLineEdit(str(Path.home() / "rigctl-sessions"))
        self.out.setToolTip("Every session gets a new folder in here")
        self.seed = QSpinBox(maximum=MAX_SEED)
        self.seed.setToolTip("Seed of the random order of trials; stored with the session")
        requested = self.path_requested
        self.open_button = browse_button(requested, PathKind.PROTOCOL, self.add_protocol)
        self.out_button = browse_button(requested, PathKind.OUTPUT, self.out.setText)
        self.continue_button = browse_button(
            requested, PathKind.INTERRUPTED, self.continue_session, "Continue a session …"
        )
        self.plan_rows = {name: label("–") for name in PLAN_ROWS}
        self.problem = label("", "bad", wraps=True)
        self.buttons = {"Start": push_button("Start", self._start)}
        for name in ("Pause", "Resume", "Abort"):
            send = partial(self.command_requested.emit, name.lower(), {})
            self.buttons[name] = push_button(name, send)
        self.bar = QProgressBar(format="%p %")
        self.run_rows = {name: elastic(label("–")) for name in _RUN_ROWS}
        self.state = label("No run", "heading", wraps=True)
        self._is_planned = False
        self._lay_out()
        self._connect()
        self._list_protocols()
        self.show_status(EngineStatus())

    def add_protocol(self, path: str) -> None:
        """Add a file to the list and choose it."""
        if self.protocol.findData(path) < 0:
            self.protocol.addItem(Path(path).name, path)
        self.protocol.setCurrentIndex(self.protocol.findData(path))

    def continue_session(self, folder: str) -> None:
        """Run the remaining trials of a session."""
        self.command_requested.emit("start", {"resume": folder, "yes": False})

    def show_status(self, status: EngineStatus) -> None:
        """Enable the commands that are possible and show the run's progress."""
        run = status.run
        is_connected = status.drum_connected and status.taxels_connected
        is_ready = is_connected and not status.fault and not run.is_active
        can_start = is_ready and not status.is_moved_by_hand
        self.buttons["Start"].setEnabled(self._is_planned and can_start)
        self.continue_button.setEnabled(can_start)
        reason = _MOVED_BY_HAND if status.is_moved_by_hand else ""
        self.buttons["Start"].setToolTip(reason)
        self.buttons["Pause"].setEnabled(run.state == "running")
        self.buttons["Resume"].setEnabled(run.state == "paused")
        self.buttons["Abort"].setEnabled(run.is_active)
        inputs = (self.protocol, self.out, self.seed, self.open_button, self.out_button)
        for widget in inputs:
            widget.setEnabled(not run.is_active)
        self._show_run(run)

    def show_plan(self, plan: PlanSummary) -> None:
        """Show the plan of the chosen protocol, or why it cannot run."""
        for row, text in zip(self.plan_rows.values(), plan.texts, strict=True):
            row.setText(text)
        self.problem.setText(plan.problem)
        self.problem.setVisible(bool(plan.problem))
        self._is_planned = not plan.problem
        with QSignalBlocker(self.seed):
            self.seed.setValue(plan.seed)

    def showEvent(self, event: QShowEvent) -> None:
        """Plan the protocol when the panel is visible for the first time."""
        super().showEvent(event)
        if not self._is_planned and not self.problem.text():
            self._request_plan()

    def _list_protocols(self) -> None:
        """List the protocols of the program, the quick one first."""
        paths = resources.protocols().glob("*.toml")
        for path in sorted(paths, key=lambda path: (path.stem != "quick", path.stem)):
            self.protocol.addItem(path.stem, str(path))
            index = self.protocol.count() - 1
            self.protocol.setItemData(index, str(path), Qt.ItemDataRole.ToolTipRole)

    def _show_run(self, run: RunStatus) -> None:
        show_text(self.state, run_sentence(run))
        set_property(self.state, "role", "bad" if run.state == "failed" else "heading")
        self.bar.setMaximum(max(run.trials_planned, 1))
        self.bar.setValue(run.trials_committed)
        left = f", {duration(run.eta_s)} left" if run.is_active and run.eta_s is not None else ""
        progress = f"{run.trials_committed} of {run.trials_planned} trials{left}"
        show_text(self.run_rows["Progress"], progress if run.trials_planned else "–")
        show_text(self.run_rows["Trial"], trial_sentence(run))
        rejected = f"{run.trials_rejected}" if run.trials_planned else "–"
        show_text(self.run_rows["Rejected"], rejected)
        self.run_rows["Session"].setText(Path(run.session).name if run.session else "–")
        self.run_rows["Session"].setToolTip(plain_tooltip(run.session or ""))

    def _request_plan(self, seed: int | None = None) -> None:
        """Request a plan, and drop a waiting request; Start is disabled until the plan arrives."""
        self._is_planned = False
        if path := self.protocol.currentData():
            self._next_plan = (path, seed)
            self._submit_plan()

    def _submit_plan(self) -> None:
        if self._next_plan is not None and not self.worker.is_busy:
            (path, seed), self._next_plan = self._next_plan, None
            self.worker.submit("plan_protocol", path=path, seed=seed)

    def _finish_plan(self, plan: PlanSummary) -> None:
        if self._next_plan is None:
            self.show_plan(plan)
        self._submit_plan()

    def _start(self) -> None:
        path = self.protocol.currentData()
        time = QDateTime.currentDateTimeUtc().toString("yyyyMMdd-HHmmss")
        folder = f"{Path(self.protocol.currentText()).stem}-{time}"
        out = str(Path(self.out.text()).expanduser() / folder)
        args = {"protocol": path, "out": out, "seed": self.seed.value(), "yes": False}
        self.command_requested.emit("start", args)

    def _connect(self) -> None:
        self.worker.finished.connect(lambda _, plan: self._finish_plan(plan))
        self.worker.failed.connect(lambda _, text: self._finish_plan(PlanSummary(problem=text)))
        self.protocol.currentIndexChanged.connect(lambda _: self._request_plan())
        self.seed.valueChanged.connect(self._request_plan)

    def _lay_out(self) -> None:
        column = vbox(self._protocol_box(), self._run_box(), spacing=4, margins=(6, 4, 6, 6))
        column.addStretch(1)
        self.setLayout(column)

    def _protocol_box(self) -> QGroupBox:
        box, form = group_box("Protocol", form_layout(5))
        form.addRow("File", hbox(self.protocol, self.open_button))
        form.addRow("Save in", hbox(self.out, self.out_button))
        form.addRow("Seed", self.seed)
        for name, text in self.plan_rows.items():
            form.addRow(label(name, "muted"), text)
        form.addRow(self.problem)
        return box

    def _run_box(self) -> QGroupBox:
        box, column = group_box("Run", QVBoxLayout())
        grid = QGridLayout()
        for place, button in enumerate(self.buttons.values()):
            grid.addWidget(button, place // 2, place % 2)
        grid.addWidget(self.continue_button, 2, 0, 1, 2)
        column.addLayout(grid)
        column.addWidget(self.state)
        column.addWidget(self.bar)
        form = form_layout(3)
        for name, text in self.run_rows.items():
            form.addRow(label(name, "muted"), text)
        column.addLayout(form)
        return box


def run_sentence(run: RunStatus) -> str:
    """Return the run's state, with the reasons of a pause."""
    if run.text:
        return run.text
    words = _STATES.get(run.state, run.state)
    return f"{words} ({', '.join(run.reasons)})" if run.reasons else words


def trial_sentence(run: RunStatus) -> str:
    """Return the conditions of the present trial."""
    if not run.current:
        return "–"
    trial = run.current
    mounting = f", mounting {trial.mount}" if trial.mount > 1 else ""
    return (
        f"#{run.trial_id or 0}: {trial.texture}, {trial.speed_mm_s:g} mm/s, "
        f"{trial.force_g:g} g, repeat {trial.repeat}{mounting}"
    )
