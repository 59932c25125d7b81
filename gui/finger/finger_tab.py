"""The Finger tab: its settings, controls and views, its engine, and what makes its models."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
from PySide6.QtCore import QObject, Qt, Signal
from PySide6.QtWidgets import QCheckBox, QGridLayout, QGroupBox, QLineEdit, QWidget

from gui.analysis.task_values import FingerSessionInfo
from gui.analysis.worker import Worker
from gui.finger.finger_view import FingerView
from gui.finger.scan_plots import scan_name
from gui.link.engine_link import (
    JOIN,
    NOT_CONNECTED,
    SIMULATED,
    ClientFactory,
    EngineLink,
    FingerEngineSpec,
    another_on,
    is_joined,
    open_finger_client,
    shown_rig,
)
from gui.live.health import FingerHealthStrip
from gui.operate.connection_bar import ConnectionBar
from gui.operate.event_log import injected_words
from gui.operate.operate_panel import PromptPanel
from gui.protocol.about_fields import OwnFields, about_fields, about_title
from gui.protocol.protocol_panel import RunStateBox
from gui.widgets.file_browser import FileComboBox, PathKind, browse_button
from gui.widgets.formatting import duration, time_stamp
from gui.widgets.labels import label, set_property, show_text
from gui.widgets.layouts import combo_box, container, form_layout, hbox, push_button, vbox
from gui.widgets.number_box import WholeNumberBox, has_refused
from gui.widgets.plates import world_of
from gui.widgets.theme import Theme
from gui.widgets.typed_paths import new_files_folder, typed_path
from rigctl.config import resources
from rigctl.errors import ConfigError, RigctlError
from rigctl.finger.config import load_finger_config
from rigctl.finger.live_file import FingerLiveReader
from rigctl.finger.model_files import SPEED_SCALED, model_path
from rigctl.finger.plan import load_finger_protocol
from rigctl.finger.status import (
    CurrentScan,
    FingerEngineStatus,
    FingerRunStatus,
    parse_finger_status,
)
from rigctl.finger.values import RUN_FIRST_SLIDE, ScanKind, Stage

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
        self.models = label("", wraps=True)
        self.run_state = RunStateBox(_ROWS, _STATES)
        self.run_state.continue_requested.connect(self.continue_requested)
        self.continue_buttons = (self.continue_button, self.run_state.continue_button)
        self.state, self.rows = self.run_state.state, self.run_state.rows
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
        for button in self.continue_buttons:
            button.setEnabled(is_free)
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

    def forget_refusal(self) -> None:
        """Show no more why a start was refused: the fields have changed since."""
        if self.models.property("role") == "bad":
            self.show_models("")

    def _show_run(self, run: FingerRunStatus) -> None:
        left = f", {duration(run.eta_s)} left" if run.is_active and run.eta_s is not None else ""
        texts = dict.fromkeys(_ROWS[:-1], "–")
        if run.trials_planned:
            texts["Progress"] = f"{run.trials_committed} of {run.trials_planned} scans{left}"
            texts["Rejected"] = str(run.trials_rejected)
        if run.scan is not None:
            texts["Stage"] = run.scan.stage
            scan = run.scan
            texts["Scan"] = f"{scan_name(scan)}: {scan.texture}, {scan.profile}"
        self.run_state.show_run(run, run.trials_planned, texts)

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
        column.addLayout(self.run_state)
        column.addWidget(self.models)
        column.addWidget(self._fault_row)
        self.setLayout(column)
        self.show_models("")


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
_REPRESENTATIONS = {kind.value.replace(" and ", " + "): kind.key for kind in ScanKind}


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
        self.model = QLineEdit(placeholderText="Session or model file")
        self.representation = combo_box(_REPRESENTATIONS)
        self.representation.setCurrentIndex(self.representation.findData(SPEED_SCALED))
        self.representation.setToolTip("What names the scans; the board has its gain for the force")
        self.components = WholeNumberBox(minimum=1, maximum=180, value=DEFAULT_COMPONENTS)
        self.components.setToolTip("Principal components of the models")
        self.out = QLineEdit(str(Path.home() / "rigctl-sessions"))
        self.out.setToolTip("Every session gets a new folder in here")
        self.seed, self.session = WholeNumberBox(maximum=MAX_SEED), WholeNumberBox(maximum=9999)
        self.seed.setToolTip("Seed of the virtual finger; the order of scans is the protocol's")
        self.session.setToolTip(
            "Session of the virtual finger: the sensor drifts from one to the next"
        )
        self.about, self.own = about_fields("finger.toml"), OwnFields()
        self.unasked = QCheckBox("Lay simulated plates unasked")
        self.plan, self.problem = label("", "muted", wraps=True), label("", "bad", wraps=True)
        self._is_simulated = True
        self._lay_out()
        self._list_protocols()
        self.stage.currentIndexChanged.connect(lambda _: self._show_stage())
        self.protocol.currentIndexChanged.connect(lambda _: self._show_plan())
        for field in (self.model, self.out):
            field.textChanged.connect(lambda _: self.changed.emit())
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
        args: dict[str, Any] = {
            "stages": [part.value for part in STAGES[stage]],
            "protocol": self.protocol.currentData(),
            "out": str(new_files_folder(self.out.text()) / f"finger-{stage}-{time_stamp()}"),
            "yes": self._is_simulated and self.unasked.isChecked(),
            **self.said(),
        }
        if stage != TRAIN:
            args["model"] = self.model_file()
        return StartRequest(self.engine(rig), args)

    def said(self) -> dict[str, Any]:
        """Return what is said of the session, by attribute."""
        said = {name: field.text().strip() for name, field in self.about.items()}
        return {**said, **self.own.said()}

    @property
    def remembered(self) -> dict[str, QLineEdit | OwnFields]:
        """What the next start of the window asks no more, by the key of the settings."""
        said = {f"finger/{name}": field for name, field in self.about.items()}
        return {"scans_in": self.out, "finger/own": self.own, **said}

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
        for name, field in self.about.items():
            form.addRow(about_title(name), field)
        form.addRow(self.own)
        column = vbox(spacing=4, margins=(8, 6, 8, 8))
        column.addLayout(form)
        for widget in (self.unasked, self.plan, self.problem):
            column.addWidget(widget)
        self.setLayout(column)


RIGS = {
    "Virtual finger": "virtual",
    "Firmware on a simulated chip": "firmware",
    "Join the running engine": JOIN,
}


class FingerBar(ConnectionBar):
    """The connection of a rig of the moving finger."""

    connect_requested = Signal(str)
    rig_changed = Signal()

    def __init__(self) -> None:
        super().__init__(FileComboBox(RIGS, PathKind.FINGER_FILE, "Open a finger.toml …", 215))
        self.rig.set_own_tooltip("Rig of the moving finger")
        self.connect_clicked.connect(self._request_connection)
        self.rig.currentIndexChanged.connect(lambda _: self.rig_changed.emit())
        state = vbox(self.state, self.state_words)
        row = (self.rig, self.connect_button, state, self.recording_display)
        self.setLayout(hbox(*row, wide=2, spacing=8))

    @property
    def is_simulated(self) -> bool:
        """Whether the chosen rig is simulated."""
        return self.rig.currentData() in SIMULATED

    def show_status(self, status: FingerEngineStatus) -> None:
        """Show the run's state and the rig, and the recording lamp."""
        run = status.run
        is_whole = status.finger_connected and status.tracker_connected
        is_good = is_whole and run.state != "failed"
        self._show_state(run.state.upper(), _words(status), is_good=is_good)
        self.recording_display.show_status(run.state, status.recording)

    def _request_connection(self) -> None:
        self.connect_requested.emit(self.rig.currentData())


def _words(status: FingerEngineStatus) -> str:
    if not status.finger_connected:
        return "the finger board is not connected"
    if not status.tracker_connected:
        return "the tracker is not connected"
    return f"{status.rig}; {status.tracker}"


ENGINE_SILENT = "the finger's engine does not answer"
_NEXT = {TRAIN: CALIBRATE, CALIBRATE: RUN}
_UNTOLD = ("batch", "prediction")
"""Events of every 100 ms, which would flood the log."""


class FingerTab(QObject):
    """Connects the parts. ``factory`` opens the engine of a :class:`FingerEngineSpec`."""

    reported = Signal(str, str)
    """Kind and text for the event log."""
    path_requested = Signal(object, object)

    def __init__(self, theme: Theme, factory: ClientFactory = open_finger_client) -> None:
        super().__init__()
        self.link: EngineLink[FingerEngineStatus, FingerLiveReader] = EngineLink(
            factory, parse_finger_status, FingerLiveReader
        )
        self.bar, self.health, self.prompt_panel = FingerBar(), FingerHealthStrip(), PromptPanel()
        self.setup, self.run_box, self.view = FingerSetupForm(), FingerRunBox(), FingerView(theme)
        column = vbox(self.setup, self.run_box, spacing=4, margins=(6, 4, 6, 6), tall=-1)
        self.panel = container(column)
        self.worker = Worker()
        self._engine: FingerEngineSpec | None = None
        self._waiting: dict[str, Any] | None = None
        self._stage = self._folder = ""
        """Stage and session of the run that this window started, until its models are made."""
        self._is_silent = False
        self._connect_engine()
        self._connect_controls()
        self._show_state()

    def poll(self, *, is_visible: bool) -> None:
        """Process messages; pull and draw the live data while the view is visible."""
        self.link.poll()
        if self.link.live is not None and is_visible:
            self.view.refresh(self.link.live)

    def connect_rig(self, rig: str) -> None:
        """Start or join the engine of a rig."""
        if self.setup.has_refused:
            return
        self.bar.rig.choose(shown_rig(rig))
        self._open(self.setup.engine(rig))

    def start_another(self) -> None:
        """Start another engine on the chosen simulated rig, beside those that run."""
        self.connect_rig(another_on(self.bar.rig.currentData()))

    def close(self) -> None:
        """Leave the engine, which continues a run, and end the worker."""
        self.worker.close()
        self.link.close()
        self.link.wait_closed()

    def _connect_engine(self) -> None:
        link = self.link
        link.opening.connect(self.bar.show_opening)
        link.opened.connect(self._on_opened)
        link.closed.connect(self._on_closed)
        link.refused.connect(self._on_refused)
        link.answered.connect(self._on_answered)
        link.event_received.connect(self._on_event)
        link.status_changed.connect(self._on_status)
        link.silent.connect(self._on_silent)
        link.reported.connect(self.reported)
        # Queued: when it arrives, Qt has put the painted answer on the screen.
        queued = Qt.ConnectionType.QueuedConnection
        self.view.answer.painted.connect(self._report_shown, queued)

    def _connect_controls(self) -> None:
        bar, setup, run_box = self.bar, self.setup, self.run_box
        bar.connect_requested.connect(self.connect_rig)
        bar.disconnect_requested.connect(self.link.close)
        bar.rig_changed.connect(lambda: setup.show_rig(simulated=bar.is_simulated))
        bar.rig_changed.connect(lambda: setup.own.show_asked(_asked_by(bar.rig.currentData())))
        for source in (bar.rig, setup, run_box):
            source.path_requested.connect(self.path_requested)
        for follow in (run_box.forget_refusal, self._show_state):
            setup.changed.connect(follow)
        for panel in (run_box, self.prompt_panel):
            panel.command_requested.connect(self._request)
        run_box.start_requested.connect(self._start)
        run_box.models_requested.connect(self._make_models)
        run_box.continue_requested.connect(self._read_session)
        self.worker.finished.connect(self._on_worker)
        self.worker.failed.connect(self._on_worker_failed)

    def _request(self, command: str, args: dict[str, Any]) -> None:
        self.link.request(command, **args)

    def _start(self) -> None:
        if self.setup.has_refused:
            return
        try:
            request = self.setup.request(self.bar.rig.currentData())
        except RigctlError as error:
            self.reported.emit("refused", f"start: {error}")
            self.run_box.show_models(str(error), "bad")
            return
        self._stage = self.setup.stage.currentData()
        self.run_box.show_models("")
        self._start_on(request)

    def _start_on(self, request: StartRequest) -> None:
        """Start on the connected engine if it has the right person, else on a new one."""
        self._folder = str(request.args.get("out") or request.args["resume"])
        if self.link.is_connected and self._is_same_person(request.engine):
            self.link.request("start", **request.args)
            return
        self._waiting = request.args
        if self.link.is_connected:
            waiting, self._waiting = self._waiting, None  # closing forgets what waits
            self.link.close()
            self._waiting = waiting
        self._open(request.engine)

    def _is_same_person(self, wanted: FingerEngineSpec) -> bool:
        has = self._engine
        if has is None or has.rig not in SIMULATED:
            return True
        return has[:3] == wanted[:3]

    def _open(self, engine: FingerEngineSpec) -> None:
        self._engine = None if is_joined(engine.rig) else engine
        self.bar.show_connecting()
        self.reported.emit("rig", f"finger: connecting to {engine.rig} …")
        self.link.open(engine)
        self._show_state()

    def _on_opened(self) -> None:
        self._is_silent = False
        self.view.clear()
        self.bar.show_connected()
        self.reported.emit("rig", "finger: connected")
        if self._waiting is not None:
            args, self._waiting = self._waiting, None
            self.link.request("start", **args)

    def _on_closed(self, reason: str) -> None:
        self._waiting = None
        self.bar.show_disconnected(reason)
        if (engine := self.link.lost_engine) is not None:
            self.bar.offer_again(engine)
        self.health.show_nothing()
        self.prompt_panel.show_prompt(None)
        self.view.show_status(FingerEngineStatus())
        self._show_state()
        self.reported.emit("rig" if reason == NOT_CONNECTED else "lost", f"finger: {reason}")

    def _on_refused(self, command: str, sentence: str) -> None:
        self.reported.emit("refused", f"{command}: {sentence}")

    def _on_answered(self, command: str, result: dict[str, Any]) -> None:
        if command == "inject" and "injected" in result:
            self.reported.emit("done", f"bench: {injected_words(result['injected'], FAULTS)}")

    def _on_silent(self, seconds: float) -> None:
        self.bar.show_silent(seconds)
        if not self._is_silent:
            self._is_silent = True
            self.health.show_nothing()
            self.reported.emit("lost", ENGINE_SILENT)

    def _on_event(self, message: dict[str, Any]) -> None:
        kind, text, data = message["event"], message["text"], message["data"]
        self._take_scan_event(kind, data, message["at_s"])
        if kind == "ready":
            self.prompt_panel.set_world(world_of(data))
            self.setup.own.show_asked(data.get("asks") or ())
        if text and kind not in _UNTOLD:
            self.reported.emit(kind, text)
        if kind == "run" and (digest := data.get("digest")):
            self.reported.emit("digest", str(digest))

    def _take_scan_event(self, kind: str, data: Mapping[str, Any], at_s: float) -> None:
        """Show what an event tells of a scan."""
        record = self.view.record
        if kind == "batch":
            record.add_batch(data)
            self.view.show_record()
        elif kind == "prediction":
            record.add_prediction(data)
            self.view.show_record(data.get("sent_s"))
        elif kind == "trial":
            record.add_trial(data)
            self.view.show_record()
        elif kind == "instruction":
            record.announce(msgspec.convert(data, CurrentScan))
            self.view.begin_slide(at_s)

    def _on_status(self, status: FingerEngineStatus) -> None:
        self._is_silent = False
        self.bar.show_status(status)
        self.health.show_status(status)
        self.prompt_panel.show_prompt(status.run.prompt)
        if (scan := status.run.scan) is not None and self.view.record.scan < 0:
            self.view.record.announce(scan)
        self.view.show_status(status)
        if status.run.is_active and not self.worker.is_busy:
            self.run_box.show_models("")  # of the run before
        self._show_state()
        if status.run.state == "done" and self._stage in _NEXT and self._is_own(status.run):
            self._make_models()

    def _is_own(self, run: FingerRunStatus) -> bool:
        """Return whether this window started the run, and it is not the one before."""
        return (
            run.session is not None and Path(run.session).resolve() == Path(self._folder).resolve()
        )

    def _show_state(self) -> None:
        status = self.link.status
        is_busy = self.worker.is_busy or self._waiting is not None
        self.setup.setEnabled(not status.run.is_active)
        self.run_box.show_status(status, self.setup.can_start, is_busy)

    def _report_shown(self, scan: int, sent_s: float) -> None:
        if self.link.is_connected:
            self.link.request("shown", scan=scan, sent_s=sent_s)

    def _make_models(self) -> None:
        """Make the models of the run that has ended; the next stage needs them."""
        self._stage = ""
        session = self.link.status.run.session
        if session is None or self.worker.is_busy:
            return
        self.run_box.show_models("Making the models …")
        self.worker.submit(
            "make_finger_models",
            session=session,
            source=self.setup.model.text(),
            components=self.setup.components.value(),
        )
        self._show_state()

    def _on_worker(self, task: str, result: Any) -> None:
        if task == "make_finger_models":
            self._take_models(tuple(map(Path, result)))
        elif isinstance(result, FingerSessionInfo):
            self._continue(result)
        self._show_state()

    def _on_worker_failed(self, task: str, sentence: str) -> None:
        self.run_box.show_models(sentence, "bad")
        self.reported.emit("refused", sentence)
        self._show_state()

    def _take_models(self, models: tuple[Path, ...]) -> None:
        """Choose the new models, and the stage that uses them."""
        folder = models[0].parent
        self.setup.model.setText(str(folder))
        stage = self.setup.stage.currentData()
        self.setup.choose_stage(_NEXT.get(stage, RUN))
        names = ", ".join(path.name for path in models)
        self.run_box.show_models(f"Models: {names}. Next: {self.setup.stage.currentText()}")
        self.reported.emit("model", f"{folder}: {names}")

    def _read_session(self, path: str) -> None:
        self.worker.submit("read_finger_session", path=path)
        self._show_state()

    def _continue(self, info: FingerSessionInfo) -> None:
        """Continue an interrupted session with its own simulated person."""
        first_slide = info.slides + (RUN_FIRST_SLIDE if RUN in info.stages else 0)
        engine = FingerEngineSpec(self.bar.rig.currentData(), info.seed, info.session, first_slide)
        yes = self.setup.unasked.isChecked()
        args: dict[str, Any] = {"resume": info.path, "yes": yes, **self.setup.said()}
        self._stage = next((stage for stage in _NEXT if stage in info.stages), RUN)
        self.setup.choose_stage(self._stage)
        if self._stage != TRAIN:
            try:
                args["model"] = self.setup.model_file()
            except RigctlError as error:
                self._on_worker_failed("", str(error))
                return
        self._start_on(StartRequest(engine, args))


def _asked_by(rig: str) -> tuple[str, ...]:
    """Return the lab's own fields in a rig's file, none for one that the engine will refuse."""
    if not str(rig).endswith(".toml"):
        return ()
    try:
        return load_finger_config(Path(rig)).about.ask
    except ConfigError:
        return ()
