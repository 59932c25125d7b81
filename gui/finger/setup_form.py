"""The settings of a finger run and the simulated person; start, pause, abort, progress."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from PySide6.QtCore import QDateTime, Signal
from PySide6.QtWidgets import QCheckBox, QGridLayout, QGroupBox, QLineEdit, QProgressBar, QWidget

from gui.link.engine_clients import FingerEngineSpec
from gui.widgets.file_browser import PathKind, browse_button, new_files_folder, typed_path
from gui.widgets.formatting import capitalised, duration
from gui.widgets.labels import elastic, label, plain_tooltip, set_property, show_progress, show_text
from gui.widgets.layouts import combo_box, container, form_layout, hbox, push_button, vbox
from gui.widgets.number_box import WholeNumberBox, has_refused
from rigctl.acquisition.pause_reasons import reason_words
from rigctl.config import resources
from rigctl.errors import RigctlError
from rigctl.protocol.finger import Stage
from rigctl.protocol.finger_plan import load_finger_protocol
from rigctl.realtime.finger_rig import RUN_FIRST_SLIDE
from rigctl.realtime.messages import FingerEngineStatus, FingerRunStatus
from rigctl.realtime.model_files import ORIGINAL, SPEED_SCALED, model_path

_ROWS = ("Progress", "Stage", "Scan", "Rejected", "Session")
_STATES = {
    "idle": "No run",
    "running": "Running",
    "prompt": "Waiting for your answer above",
    "paused": "Paused",
    "done": "Done: every scan is on disk",
    "aborted": "Aborted: committed scans are kept",
    "failed": "Failed: committed scans are kept",
}
FAULTS: dict[str, dict[str, Any]] = {
    "Lift the finger for 0.5 s": {"fault": "lift", "seconds": 0.5},
    "Stand still for 1 s": {"fault": "stand_still", "seconds": 1.0},
    "Run back": {"fault": "reverse"},
    "Too fast": {"fault": "too_fast"},
    "Stop before the end": {"fault": "short_scan"},
    "Always lay plate C": {"fault": "wrong_plate", "texture": "C"},
    "Hide the tracker for 0.5 s": {"fault": "lose_tracker", "seconds": 0.5},
    "Switch the tracker off": {"fault": "unplug_tracker"},
    "Switch the tracker on": {"fault": "replug_tracker"},
    "Unplug the board": {"fault": "unplug"},
    "Plug in the board": {"fault": "replug"},
}
"""Text of each fault, and the arguments of the engine's command ``inject``."""


class FingerRunBox(QGroupBox):
    """Emits requests, and shows what the engine reports."""

    command_requested = Signal(str, dict)
    start_requested = Signal()
    models_requested = Signal()
    continue_requested = Signal(str)
    path_requested = Signal(object, object)

    def __init__(self) -> None:
        super().__init__("Run")
        self.buttons = {"Start": push_button("Start", self.start_requested.emit)}
        for name in ("Pause", "Resume", "Abort"):
            send = partial(self.command_requested.emit, name.lower(), {})
            self.buttons[name] = push_button(name, send)
        self.continue_button = browse_button(
            self.path_requested,
            PathKind.INTERRUPTED,
            self.continue_requested.emit,
            "Continue …",
        )
        self.models_button = push_button(
            "Make models",
            self.models_requested.emit,
            "Train, or centre by the calibration, the models of the last session",
        )
        self.state, self.models = label("No run", "heading", wraps=True), label("", wraps=True)
        self.bar = QProgressBar(format="%p %")
        self.rows = {name: elastic(label("–")) for name in _ROWS}
        self.fault = combo_box({text: text for text in FAULTS})
        self.inject = push_button("Inject", self._inject)
        self.inject.setAccessibleName("Inject the chosen fault")
        self._fault_row = container(hbox(self.fault, self.inject))
        self._lay_out()

    def show_status(self, status: FingerEngineStatus, can_start: bool, is_busy: bool) -> None:
        """Show the run; ``is_busy``: models are being made, or an engine is starting."""
        run = status.run
        is_free = not run.is_active and not is_busy
        self.buttons["Start"].setEnabled(is_free and can_start)
        self.continue_button.setEnabled(is_free)
        self.models_button.setEnabled(is_free and run.has_ended and run.session is not None)
        self.buttons["Pause"].setEnabled(run.state in ("running", "prompt"))
        self.buttons["Resume"].setEnabled(run.state == "paused")
        self.buttons["Abort"].setEnabled(run.is_active)
        for part in (self._fault_row, self.inject):
            part.setVisible(status.simulated)
        self._show_run(run)

    def show_models(self, text: str, role: str = "") -> None:
        """Show how far the models are."""
        show_text(self.models, text)
        set_property(self.models, "role", role)
        self.models.setVisible(bool(text))

    def _show_run(self, run: FingerRunStatus) -> None:
        show_text(self.state, run_sentence(run))
        set_property(self.state, "role", "bad" if run.state == "failed" else "heading")
        show_progress(self.bar, run.trials_committed, run.trials_planned)
        left = f", {duration(run.eta_s)} left" if run.is_active and run.eta_s is not None else ""
        texts = dict.fromkeys(_ROWS, "–")
        if run.trials_planned:
            texts["Progress"] = f"{run.trials_committed} of {run.trials_planned} scans{left}"
            texts["Rejected"] = str(run.trials_rejected)
        if run.scan is not None:
            texts["Stage"] = run.scan.stage
            texts["Scan"] = f"{run.scan.texture}, {run.scan.profile}, attempt {run.scan.attempt}"
        if run.session is not None:
            texts["Session"] = Path(run.session).name
        for name, text in texts.items():
            show_text(self.rows[name], text)
        self.rows["Session"].setToolTip(plain_tooltip(run.session or ""))

    def _inject(self) -> None:
        self.command_requested.emit("inject", FAULTS[self.fault.currentText()])

    def _lay_out(self) -> None:
        grid = QGridLayout()
        buttons: tuple[QWidget, ...] = (
            *self.buttons.values(),
            self.continue_button,
            self.models_button,
        )
        for place, button in enumerate(buttons):
            grid.addWidget(button, place // 2, place % 2)
        column = vbox(spacing=4, margins=(8, 6, 8, 8))
        column.addLayout(grid)
        column.addWidget(self.state)
        column.addWidget(self.bar)
        form = form_layout(2)
        for name, text in self.rows.items():
            form.addRow(label(name, "muted"), text)
        column.addLayout(form)
        column.addWidget(self.models)
        column.addWidget(self._fault_row)
        self.setLayout(column)
        self.show_models("")


def run_sentence(run: FingerRunStatus) -> str:
    """Return the run's state, with the reasons of a pause."""
    if run.text:
        return capitalised(run.text)
    words = _STATES.get(run.state, run.state)
    reasons = reason_words(run.reasons)
    return f"{words} ({reasons})" if reasons else words


MAX_SEED = 2**31 - 1
DEFAULT_COMPONENTS = 25
TRAIN, CALIBRATE, RUN = Stage.TRAIN.value, Stage.CALIBRATE.value, Stage.RUN.value
STAGES: dict[str, tuple[Stage, ...]] = {
    TRAIN: (Stage.NORMALISE, Stage.TRAIN),
    CALIBRATE: (Stage.CALIBRATE,),
    RUN: (Stage.RUN,),
}
_STAGE_TEXTS = {
    "1 Train": TRAIN,
    "2 Calibrate": CALIBRATE,
    "3 Run in real time": RUN,
}
_REPRESENTATIONS = {"Speed Scaled": SPEED_SCALED, "Original": ORIGINAL}


class StartRequest(NamedTuple):
    """An engine, and the arguments of its command ``start``."""

    engine: FingerEngineSpec
    args: dict[str, Any]


class FingerSetupForm(QGroupBox):
    """The choices before a start."""

    path_requested = Signal(object, object)
    changed = Signal()

    def __init__(self) -> None:
        super().__init__("Experiment")
        self.stage = combo_box(_STAGE_TEXTS)
        self.protocol = combo_box({})
        self.model = QLineEdit(placeholderText="Session folder or model file")
        self.representation = combo_box(_REPRESENTATIONS)
        self.representation.setToolTip("With or without speed scaling")
        self.components = WholeNumberBox(minimum=1, maximum=180, value=DEFAULT_COMPONENTS)
        self.components.setToolTip("Principal components of the models")
        self.out = QLineEdit(str(Path.home() / "rigctl-sessions"))
        self.out.setToolTip("Every session gets a new folder in here")
        self.seed, self.session = WholeNumberBox(maximum=MAX_SEED), WholeNumberBox(maximum=9999)
        self.seed.setToolTip("Seed of the virtual finger; the order of scans is the protocol's")
        self.session.setToolTip(
            "Session of the virtual finger: the sensor drifts from one to the next"
        )
        self.unasked = QCheckBox("Lay simulated plates unasked")
        self.plan, self.problem = label("", "muted", wraps=True), label("", "bad", wraps=True)
        self._is_simulated = True
        self._lay_out()
        self._list_protocols()
        self.stage.currentIndexChanged.connect(lambda _: self._show_stage())
        self.protocol.currentIndexChanged.connect(lambda _: self._show_plan())
        self._show_stage()

    @property
    def can_start(self) -> bool:
        """Whether there is a plan."""
        return not self.problem.text()

    def add_protocol(self, path: str) -> None:
        """Add a file to the list and choose it."""
        if self.protocol.findData(path) < 0:
            self.protocol.addItem(Path(path).name, path)
        self.protocol.setCurrentIndex(self.protocol.findData(path))

    def show_rig(self, *, simulated: bool) -> None:
        """Offer seed and session for a simulated rig only."""
        self._is_simulated = simulated
        for widget in (self.seed, self.session, self.unasked):
            widget.setEnabled(simulated)

    def choose_stage(self, stage: str) -> None:
        """Choose a stage; a simulated calibration or run is another session than the training."""
        self.stage.setCurrentIndex(self.stage.findData(stage))

    @property
    def has_refused(self) -> bool:
        """Whether a field has a refused text; the first one then says why, with the focus."""
        fields = (self.components, self.seed, self.session)
        return has_refused(*(field for field in fields if field.isVisible()))

    def engine(self, rig: str) -> FingerEngineSpec:
        """Return the engine of a rig with the chosen person."""
        first_slide = RUN_FIRST_SLIDE if self.stage.currentData() == RUN else 0
        return FingerEngineSpec(rig, self.seed.value(), self.session.value(), first_slide)

    def request(self, rig: str) -> StartRequest:
        """Return what to start. Raises WrongUse without the model or the folder that it needs."""
        stage = self.stage.currentData()
        time = QDateTime.currentDateTimeUtc().toString("yyyyMMdd-HHmmss")
        args: dict[str, Any] = {
            "stages": [part.value for part in STAGES[stage]],
            "protocol": self.protocol.currentData(),
            "out": str(new_files_folder(self.out.text()) / f"finger-{stage}-{time}"),
            "yes": self._is_simulated and self.unasked.isChecked(),
        }
        if stage != TRAIN:
            args["model"] = self.model_file()
        return StartRequest(self.engine(rig), args)

    def model_file(self) -> str:
        """Return the chosen model's file. Raises WrongUse where there is none."""
        is_run = self.stage.currentData() == RUN
        kind = self.representation.currentData() if is_run else SPEED_SCALED
        return str(model_path(typed_path(self.model.text()), kind))

    def _show_stage(self) -> None:
        stage = self.stage.currentData()
        for row, stages in (
            (self._model_row, (CALIBRATE, RUN)),
            (self.representation, (RUN,)),
            (self.components, (TRAIN,)),
        ):
            self._form.setRowVisible(row, stage in stages)
        self.session.setValue(0 if stage == TRAIN else 1)
        self._show_plan()

    def _show_plan(self) -> None:
        """Show the size of the plan, or why there is none."""
        self.plan.clear()
        self.problem.clear()
        if self.protocol.currentData() is None:
            return
        stages = STAGES[self.stage.currentData()]
        try:
            plan = load_finger_protocol(Path(self.protocol.currentData())).plan(stages)
        except RigctlError as error:
            self.problem.setText(str(error))
        else:
            plates = ", ".join(plan.protocol.textures)
            time = duration(plan.duration_s)
            self.plan.setText(f"{len(plan.trials)} scans of plates {plates}, about {time}")
        self.problem.setVisible(bool(self.problem.text()))
        self.changed.emit()

    def _list_protocols(self) -> None:
        paths = resources.finger_protocols().glob("*.toml")
        for path in sorted(paths, key=lambda path: (path.stem != "quick", path.stem)):
            self.protocol.addItem(path.stem, str(path))

    def _lay_out(self) -> None:
        requested = self.path_requested
        open_button = browse_button(requested, PathKind.PROTOCOL, self.add_protocol)
        model_button = browse_button(requested, PathKind.FINGER_MODEL, self.model.setText)
        out_button = browse_button(requested, PathKind.OUTPUT, self.out.setText)
        form = self._form = form_layout(4)
        self._model_row = hbox(self.model, model_button)
        form.addRow("Stage", self.stage)
        form.addRow("Protocol", hbox(self.protocol, open_button))
        form.addRow("Model", self._model_row)
        form.addRow("Answers", self.representation)
        form.addRow("Components", self.components)
        form.addRow("Save in", hbox(self.out, out_button))
        form.addRow("Seed", self.seed)
        form.addRow("Session", self.session)
        column = vbox(spacing=4, margins=(8, 6, 8, 8))
        column.addLayout(form)
        for widget in (self.unasked, self.plan, self.problem):
            column.addWidget(widget)
        self.setLayout(column)
