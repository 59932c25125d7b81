"""The Finger tab: its controls and views, its engine, and the worker that makes its models."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from PySide6.QtCore import QObject, Qt, Signal

from gui.analysis.tasks.task_values import FingerSessionInfo
from gui.analysis.tasks.worker import Worker
from gui.finger.finger_health import FingerHealthStrip
from gui.finger.finger_view import FingerView
from gui.finger.setup_form import (
    CALIBRATE,
    FAULTS,
    RUN,
    TRAIN,
    FingerRunBox,
    FingerSetupForm,
    StartRequest,
)
from gui.link.engine_clients import (
    JOIN,
    SIMULATED,
    FingerEngineSpec,
    another_on,
    is_joined,
    open_finger_client,
    shown_rig,
)
from gui.link.engine_link import NOT_CONNECTED, ClientFactory, EngineLink
from gui.operate.action_results import injected_words
from gui.operate.connection_bar import ConnectionBar
from gui.operate.operate_panel import PromptPanel
from gui.widgets.file_browser import PathKind
from gui.widgets.file_combo_box import FileComboBox
from gui.widgets.layouts import container, hbox, vbox
from gui.widgets.theme import Theme
from rigctl.errors import RigctlError
from rigctl.realtime.finger_rig import RUN_FIRST_SLIDE
from rigctl.realtime.live_file import FingerLiveReader
from rigctl.realtime.messages import FingerEngineStatus, FingerRunStatus, parse_finger_status

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
        column = vbox(self.setup, self.run_box, spacing=4, margins=(6, 4, 6, 6))
        column.addStretch(1)
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
        self.worker.poll()
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
        self.worker.cancel()
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
        for source in (bar.rig, setup, run_box):
            source.path_requested.connect(self.path_requested)
        setup.changed.connect(self._show_state)
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
            record.announce(str(data["texture"]), str(data["profile"]))
            self.view.begin_slide(at_s)

    def _on_status(self, status: FingerEngineStatus) -> None:
        self._is_silent = False
        self.bar.show_status(status)
        self.health.show_status(status)
        self.prompt_panel.show_prompt(status.run.prompt)
        if (scan := status.run.scan) is not None and self.view.record.scan < 0:
            self.view.record.announce(scan.texture, scan.profile)
        self.view.show_status(status)
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
        args: dict[str, Any] = {"resume": info.path, "yes": self.setup.unasked.isChecked()}
        self._stage = next((stage for stage in _NEXT if stage in info.stages), RUN)
        self.setup.choose_stage(self._stage)
        if self._stage != TRAIN:
            try:
                args["model"] = self.setup.model_file()
            except RigctlError as error:
                self._on_worker_failed("", str(error))
                return
        self._start_on(StartRequest(engine, args))
