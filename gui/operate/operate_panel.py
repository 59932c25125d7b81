"""The panel Operate: bring-up, jog, set-points, approach, run, retract, clear a fault."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import NamedTuple, Protocol

from PySide6.QtCore import QEvent, QSize, Qt, Signal
from PySide6.QtGui import QFont, QFontMetrics, QKeySequence, QShortcut
from PySide6.QtWidgets import (
    QGridLayout,
    QGroupBox,
    QHBoxLayout,
    QLabel,
    QLineEdit,
    QPushButton,
    QWidget,
)

from gui.operate.alarms import RELEASE_FIRST
from gui.operate.bench_controls import BenchControls
from gui.widgets.data_ages import DataAges, stale_words
from gui.widgets.file_browser import PathKind, browse_button
from gui.widgets.formatting import time_stamp
from gui.widgets.labels import (
    Level,
    StatusLamp,
    Strip,
    elastic,
    label,
    set_property,
    show_text,
    show_tooltip,
)
from gui.widgets.layouts import (
    EventWatch,
    FlowLayout,
    container,
    focus_wheel,
    form_layout,
    group_box,
    hbox,
    push_button,
    vbox,
)
from gui.widgets.number_box import NumberBox, has_refused
from gui.widgets.plates import PlateSign, World
from gui.widgets.typed_paths import folder_problem, new_files_folder
from rigctl.boards.drum_registers import BY_NAME
from rigctl.boards.drum_states import State, StateEvent, next_state
from rigctl.config.rig_config import RigLimits
from rigctl.engine.calibration_values import LOADCELL, RANGE, WIRING
from rigctl.engine.rpc.messages import EngineStatus, PromptStatus, RecordingStatus

CALIBRATE_TIP = (
    "Calibrate load cell and force loop, measure imbalance and taxel ranges, identify taxels"
)
STEPS, STEPS_TIP = "All steps", "List each step of the bring-up, and whether it is done"
SETUP = "setup"
READY = "Ready to approach"
_ON = (State.ARMED, State.POSITION, State.APPROACH, State.HOLD, State.RUN, State.RETRACT)


class BringUpStep(NamedTuple):
    """A step: whether it is done, in words, and the command that does it.

    ``part``: the part of the page Calibrate, or the page Set up, that does it, empty for a
    command. ``is_needed``: the drum cannot approach without it.
    """

    name: str
    is_done: bool
    words: str
    command: str = ""
    part: str = ""
    is_needed: bool = False


def bring_up_steps(status: EngineStatus) -> list[BringUpStep]:
    """Return the steps in their order."""
    taxels = status.boards.get("taxels")
    findings = taxels.self_test if taxels is not None else None
    is_on = status.drum_connected and status.state in _ON
    tested = "not run" if findings is None else _findings(len(findings))
    calibrated = status.loadcell_calibrated
    is_commissioned = status.commissioned
    return [
        BringUpStep(
            "Set up",
            is_commissioned,
            "commissioned" if is_commissioned else "not commissioned for its wiring",
            part=SETUP,
            is_needed=True,
        ),
        BringUpStep("Self-test", findings == (), tested, "test_taxels"),
        BringUpStep("Arm", is_on, "on" if is_on else "off", "arm", is_needed=True),
        BringUpStep("Home", status.homed, "homed" if status.homed else "angle unknown", "home"),
        BringUpStep(
            "Tare", status.tared, "tared" if status.tared else "no zero", "tare", is_needed=True
        ),
        BringUpStep(
            "Taxel range",
            status.has_taxel_range,
            _range_words(status),
            part=RANGE,
        ),
        BringUpStep("Load cell", bool(calibrated), calibrated or "nominal scale", part=LOADCELL),
        BringUpStep(
            "Taxel order",
            status.has_taxel_order,
            "identified" if status.has_taxel_order else "as drawn, not identified",
            part=WIRING,
        ),
    ]


def _range_words(status: EngineStatus) -> str:
    """Return where the ranges of the taxels are from."""
    if not status.has_taxel_range:
        return "not measured"
    if status.calibration.has_unsaved_range:
        return "measured, not saved"
    return status.range_from or "known"


def _findings(n: int) -> str:
    return "no findings" if not n else f"{n} finding{'s' if n > 1 else ''}"


def missing_words(steps: list[BringUpStep], status: EngineStatus) -> str:
    """Return what is missing before approach in one sentence."""
    if not status.drum_connected:
        return "No drum is connected"
    if status.run.is_active:
        return "The run brings the drum up by itself"
    if status.fault:
        return "Before approach: clear the fault"
    missing = [step.name.lower() for step in steps if step.is_needed and not step.is_done]
    return f"Before approach: {', '.join(missing)}" if missing else READY


class BringUpBox(QGroupBox):
    """The sentence before approach and the next step; a lamp and words for each step on request.

    It folds only when the user asks: buttons below it must not move under the mouse.
    """

    command_requested = Signal(str, dict)
    calibrate_requested = Signal(str)
    """Show this part of the page Calibrate."""
    setup_requested = Signal()
    """Show the page Set up."""

    def __init__(self) -> None:
        super().__init__("Bring-up")
        grid = QGridLayout(self)
        grid.setContentsMargins(8, 6, 8, 8)
        grid.setVerticalSpacing(2)
        steps_grid = QGridLayout()
        self.rows: dict[str, tuple[StatusLamp, QLabel]] = {}
        for row, step in enumerate(bring_up_steps(EngineStatus())):
            lamp, words = StatusLamp(11), label("", "muted", wraps=True)
            self.rows[step.name] = (lamp, words)
            for column, widget in enumerate((lamp, label(step.name), words)):
                steps_grid.addWidget(widget, row, column)
        steps_grid.setColumnStretch(2, 1)
        self.list = container(steps_grid)
        self.list.hide()
        self.steps = QPushButton(STEPS)
        self.steps.setCheckable(True)
        self.steps.setToolTip(STEPS_TIP)
        self.steps.toggled.connect(self.list.setVisible)
        self.missing = label("", "heading", wraps=True)
        self.next = push_button("Next step", self._do_next, "Do the first step that is missing")
        show_page = partial(self.calibrate_requested.emit, LOADCELL)
        self.calibrate = push_button("Calibrate …", show_page, CALIBRATE_TIP)
        self._next_step: BringUpStep | None = None
        grid.addWidget(self.missing, 0, 0, 1, 2)
        grid.addWidget(self.next, 1, 0, 1, 2)
        grid.addWidget(self.calibrate, 2, 0)
        grid.addWidget(self.steps, 2, 1)
        grid.addWidget(self.list, 3, 0, 1, 2)

    def show_status(self, status: EngineStatus) -> None:
        """Show the steps; the next one can be done while no protocol runs."""
        steps = bring_up_steps(status)
        for step in steps:
            self._show_step(step)
        show_text(self.missing, missing_words(steps, status))
        undone = [step for step in steps if not step.is_done]
        self._next_step = undone[0] if undone else None
        self.next.setText(f"Next: {undone[0].name}" if undone else "All done")
        is_free = status.drum_connected and not (status.run.is_active or status.is_moved_by_hand)
        self.next.setEnabled(bool(undone) and is_free and not status.fault)

    def _show_step(self, step: BringUpStep) -> None:
        lamp, words = self.rows[step.name]
        lamp.set_level(Level.OK if step.is_done else Level.WARN if step.is_needed else Level.OFF)
        show_text(words, step.words)
        set_property(words, "role", "warn" if step.is_needed and not step.is_done else "muted")

    def _do_next(self) -> None:
        step = self._next_step
        if step is not None and step.part == SETUP:
            self.setup_requested.emit()
        elif step is not None and step.part:
            self.calibrate_requested.emit(step.part)
        elif step is not None:
            self.command_requested.emit(step.command, {})


class PromptPanel(Strip):
    """A question and its two answers; hidden without a question."""

    command_requested = Signal(str, dict)

    def __init__(self) -> None:
        super().__init__()
        self._prompt_id = 0
        self._world: World = None
        self.plate = PlateSign()
        self.confirm = push_button("Done, continue", lambda: self._answer("ok"))
        self.abort = push_button("Abort the run", lambda: self._answer("abort"))
        self.lay_out(self.plate, self.confirm, self.abort)

    def set_world(self, world: World) -> None:
        """Take the plates of the connected rig."""
        self._world = world

    def show_prompt(self, prompt: PromptStatus | None) -> None:
        """Show a question, or hide the panel without one."""
        if prompt is None:
            self.hide()
        elif prompt.id != self._prompt_id or self.isHidden():
            self._prompt_id = prompt.id
            self.text.setText(prompt.text)
            self.plate.show_plate(prompt.texture or "", self._world)
            self.show()

    def _answer(self, answer: str) -> None:
        args = {"prompt_id": self._prompt_id, "answer": answer}
        self.command_requested.emit("answer", args)


SPEED_LATER = "The drum turns: its speed can be set once it holds still or is lifted"
_SET_TIP = "Send speed and force to the drum, which then reports what it has"


class SetPointBox(QGroupBox):
    """Speed and force: asked, and what the drum has; the ranges are those of ``rig.toml``."""

    command_requested = Signal(str, dict)

    def __init__(self) -> None:
        super().__init__("Set-points")
        self.speed = _register_spin_box("speed_set", " mm/s", 5.0)
        self.force = _register_spin_box("force_set", " g", 50.0)
        self.drum_speed, self.drum_force = label("–"), label("–")
        self.allowed = label("", "muted", wraps=True)
        self.set_button = push_button("Set", self._send, _SET_TIP)
        self._limits: RigLimits | None = None
        self._allowed = ""
        self._drum: tuple[float, float] | None = None
        self._is_own = True
        """Whether the drum should have what is asked here; a run sets it otherwise."""
        self._turns = False
        """Whether the drum turns in contact, at the speed that it had when it began."""
        for box in (self.speed, self.force):
            box.valueChanged.connect(lambda _: self._show_drum())
        self._lay_out()
        self.set_limits(RigLimits())

    def set_limits(self, limits: RigLimits) -> None:
        """Take the ranges that the engine accepts."""
        if limits == self._limits:
            return
        self._limits = limits
        self.speed.setRange(limits.speed_min_mm_s, limits.speed_max_mm_s)
        self.force.setRange(limits.force_min_g, limits.force_max_g)
        speed = f"{limits.speed_min_mm_s:g} to {limits.speed_max_mm_s:g} mm/s"
        force = f"{limits.force_min_g:g} to {limits.force_max_g:g} g"
        self._allowed = f"Allowed: {speed}, {force}"
        self._show_allowed()

    def show_status(self, status: EngineStatus) -> None:
        """Show what the drum has; a status without a drum shows nothing."""
        self._is_own = not status.run.is_active
        self.set_button.setEnabled(status.drum_connected and self._is_own)
        self._turns = status.drum_connected and status.state is State.RUN
        if status.drum_connected:
            self.set_limits(status.limits)
            self._drum = (status.speed_set_mm_s, status.force_set_g)
            self._show_drum()
        self._show_allowed()

    def show_nothing(self) -> None:
        """Forget what the drum had."""
        self._drum, self._turns = None, False
        self._show_allowed()
        self._show_drum()

    def _show_allowed(self) -> None:
        show_text(self.allowed, SPEED_LATER if self._turns else self._allowed)
        self.allowed.setToolTip("" if self._turns else "Limits of this rig: [limits] in rig.toml")

    def _show_drum(self) -> None:
        speed, force = self._drum if self._drum is not None else (None, None)
        _show_has(self.drum_speed, speed, self.speed, compares=self._is_own)
        _show_has(self.drum_force, force, self.force, compares=self._is_own)

    def _send(self) -> None:
        if has_refused(self.speed, self.force):
            return
        args = {"speed_mm_s": self.speed.value(), "force_g": self.force.value()}
        if self._turns and self._drum is not None and not _differs(self._drum[0], self.speed):
            del args["speed_mm_s"]
        self.command_requested.emit("set", args)

    def _lay_out(self) -> None:
        grid = QGridLayout(self)
        grid.setContentsMargins(8, 6, 8, 8)
        for column, title in enumerate(("", "Asked", "Drum has")):
            grid.addWidget(label(title, "muted"), 0, column)
        rows = (("Speed", self.speed, self.drum_speed), ("Force", self.force, self.drum_force))
        for row, (name, box, has) in enumerate(rows, 1):
            grid.addWidget(label(name), row, 0)
            grid.addWidget(box, row, 1)
            grid.addWidget(has, row, 2)
        grid.addWidget(self.allowed, 3, 0, 1, 2)
        grid.addWidget(self.set_button, 3, 2)
        grid.setColumnStretch(1, 1)
        grid.setColumnStretch(2, 1)


def _show_has(has: QLabel, value: float | None, asked: NumberBox, *, compares: bool) -> None:
    """Show a value of the drum; if that is compared, after ≠ where another one is asked for."""
    if value is None:
        show_text(has, "–")
        set_property(has, "role", "muted")
        return
    differs = compares and _differs(value, asked)
    text = f"{value:.{asked.decimals()}f}{asked.suffix()}"
    show_text(has, f"≠ {text}" if differs else text)
    set_property(has, "role", "warn" if differs else "heading")


def _differs(value: float, asked: NumberBox) -> bool:
    return abs(value - asked.value()) > 0.5 * 10.0 ** -asked.decimals()


def _register_spin_box(register_name: str, suffix: str, step: float) -> NumberBox:
    """Return a field with the default of the board's register."""
    register = BY_NAME[register_name]
    box = NumberBox(
        maximum=register.high * register.scale,
        value=register.default * register.scale,
        suffix=suffix,
        singleStep=step,
        decimals=1 if register.scale < 0.1 else 0,
    )
    box.setAlignment(Qt.AlignmentFlag.AlignRight)
    return focus_wheel(box)


NAMES = ("Force", "Speed", "Actuator", "Angle", "Tared", "Homed")
WIDEST = "199.9 mm/s"
LIVE = "The readings are live"


class ReadingBox(QGroupBox):
    """Readings by name, and a line that says how old they are."""

    def __init__(self) -> None:
        super().__init__("Readings")
        self.readings = {name: elastic(label("–", "heading")) for name in NAMES}
        self.age = label("", "muted")
        self._names = [label(name, "muted") for name in NAMES]
        both = zip(self._names, self.readings.values(), strict=True)
        pairs = [container(hbox(name, reading, wide=1)) for name, reading in both]
        self.setLayout(vbox(FlowLayout(*pairs), self.age, spacing=2, margins=(8, 6, 8, 8)))
        self._keep_whole()
        EventWatch(self, self._keep_whole, QEvent.Type.FontChange)

    def sizeHint(self) -> QSize:
        """Return the size for one reading in a line; the panel decides how many there are."""
        return QSize(self.minimumSizeHint().width(), super().sizeHint().height())

    def _keep_whole(self) -> None:
        bold = QFont(self.font())
        bold.setBold(True)
        name_px = max(map(QFontMetrics(self.font()).horizontalAdvance, NAMES))
        for name, reading in zip(self._names, self.readings.values(), strict=True):
            name.setMinimumWidth(name_px)
            reading.setMinimumWidth(QFontMetrics(bold).horizontalAdvance(WIDEST))

    def show_status(self, status: EngineStatus) -> None:
        """Show the readings; those of a lost drum stay, and their age tells."""
        if not status.drum_connected:
            return
        texts = {
            "Force": f"{status.force_g:.1f} g",
            "Speed": f"{status.speed_mm_s:.1f} mm/s",
            "Actuator": f"{status.actuator_position_um / 1000:.2f} mm",
            "Angle": f"{status.angle_deg:.1f}°",
            "Tared": "yes" if status.tared else "no",
            "Homed": "yes" if status.homed else "no",
        }
        for name, text in texts.items():
            self.readings[name].setText(text)

    def show_ages(self, ages: DataAges) -> None:
        """Turn the readings grey whose data are too old, and say how old they are."""
        drum, loadcell = stale_words(ages.drum_s), stale_words(ages.loadcell_s)
        for name, reading in self.readings.items():
            is_old = bool(drum or (loadcell and name == "Force"))
            set_property(reading, "role", "stale" if is_old else "heading")
        words = f"Not live: {drum}" if drum else f"Force not live: {loadcell}" if loadcell else LIVE
        show_text(self.age, words)
        set_property(self.age, "role", "muted" if words == LIVE else "warn")

    def show_nothing(self) -> None:
        """Show that there is no drum."""
        for reading in self.readings.values():
            reading.setText("–")
            set_property(reading, "role", "muted")
        show_text(self.age, "")


STEPS_MM = {-10: "Alt+Shift+Left", -1: "Alt+Left", 1: "Alt+Right", 10: "Alt+Shift+Right"}
"""Texture travel of each button, and its shortcut."""

_NOT_CONNECTED = "no drum is connected"
_OBSTACLES = {
    State.IDLE: "arm the drum first",
    State.POSITION: "the drum is moving",
    State.RETRACT: "the drum is lifting off",
    State.APPROACH: "retract first: the drum is pressing",
    State.HOLD: "retract first: the drum is in contact",
    State.RUN: "retract first: the drum is in contact",
    State.FAULT_LIFT: "clear the fault first",
    State.FAULT_OFF: "clear the fault first",
}


def jog_obstacle(status: EngineStatus) -> str:
    """Return why the drum cannot jog now; empty if it can."""
    if not status.drum_connected or status.state is None:
        return _NOT_CONNECTED
    if status.run.is_active:
        return "a protocol is running"
    if status.state is State.ARMED:
        return ""
    return _OBSTACLES.get(status.state, "the drum is starting")


class JogButtons(QWidget):
    """Buttons for mm of texture travel; disabled during a jog, so that clicks never queue up."""

    command_requested = Signal(str, dict)

    def __init__(self) -> None:
        super().__init__()
        self.buttons = {mm: self._button(mm, keys) for mm, keys in STEPS_MM.items()}
        self._obstacle = _NOT_CONNECTED
        self._is_jogging = False
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.setSpacing(4)
        row.addWidget(label("Jog", "muted"))
        for button in self.buttons.values():
            row.addWidget(button, 1)
        row.addWidget(label("mm", "muted"))
        self._update_buttons()

    def show_status(self, status: EngineStatus) -> None:
        """Enable the buttons if a jog is possible; otherwise their tooltips say why not."""
        self._obstacle = jog_obstacle(status)
        self._update_buttons()

    def finish(self) -> None:
        """End a jog: the engine has executed or refused it."""
        self._is_jogging = False
        self._update_buttons()

    def _request(self, mm: int) -> None:
        self._is_jogging = True
        self._update_buttons()
        self.command_requested.emit("jog", {"mm": float(mm)})

    def _update_buttons(self) -> None:
        obstacle = self._obstacle or ("the drum is moving" if self._is_jogging else "")
        for mm, button in self.buttons.items():
            button.setEnabled(not obstacle)
            show_tooltip(button, _tooltip(mm, obstacle))

    def _button(self, mm: int, keys: str) -> QPushButton:
        button = QPushButton(f"{mm:+d}".replace("-", "−"))
        button.setMinimumWidth(30)
        button.setAccessibleName(f"Jog {button.text()} mm")
        button.clicked.connect(lambda: self._request(mm))
        shortcut = QShortcut(QKeySequence(keys), self)
        shortcut.setAutoRepeat(False)
        shortcut.activated.connect(button.click)
        return button


def _tooltip(mm: int, obstacle: str) -> str:
    direction = "forward, as in a forward trial" if mm > 0 else "backward"
    text = f"Turn the lifted drum by {abs(mm)} mm of texture {direction} ({STEPS_MM[mm]})"
    return f"{text}. Unavailable: {obstacle}" if obstacle else text


MAX_NOTE_LETTERS = 500
_TIP = "Record samples, polls and events without a protocol until you end it"


class RecordBox(QGroupBox):
    """Folder, note, and one button that begins and ends a recording by hand."""

    command_requested = Signal(str, dict)
    path_requested = Signal(object, object)
    """Kind of the path, and the function that takes the chosen one."""

    def __init__(self) -> None:
        super().__init__("Record by hand")
        self.folder = QLineEdit(str(Path.home() / "rigctl-sessions"))
        self.folder.setToolTip("Every recording gets a new folder in here")
        self.note = QLineEdit(maxLength=MAX_NOTE_LETTERS, placeholderText="what you try out")
        self.button = push_button("Record", self._toggle, _TIP)
        self.state = label("", "muted", wraps=True)
        self._recording, self._is_possible = RecordingStatus(), False
        self.folder.textChanged.connect(lambda _: self._show())
        browse = browse_button(self.path_requested, PathKind.OUTPUT, self.folder.setText)
        form = form_layout(4)
        form.setContentsMargins(8, 6, 8, 8)
        form.addRow("Save in", hbox(self.folder, browse))
        form.addRow("Note", self.note)
        form.addRow(self.button)
        form.addRow(self.state)
        self.setLayout(form)

    def show_status(self, status: EngineStatus) -> None:
        """Show whether this recording goes on, and how much of it is on the disk."""
        self._recording = status.recording
        self._is_possible = status.taxels_connected and not status.run.is_active
        self._show()

    def _show(self) -> None:
        is_recording = self._recording.by_hand
        problem = "" if is_recording else folder_problem(self.folder.text())
        self.button.setText("End recording" if is_recording else "Record")
        self.button.setEnabled(is_recording or (self._is_possible and not problem))
        for field in (self.folder, self.note):
            field.setEnabled(not is_recording)
        set_property(self.state, "role", "heading" if is_recording else "bad")
        name = Path(self._recording.folder or "").name
        seconds = self._recording.samples_on_disk / 1000
        text = f"{seconds:.0f} s in {name}" if is_recording else ""
        show_text(self.state, f"Save in: {problem}" if problem else text)

    def _toggle(self) -> None:
        if self._recording.by_hand:
            self.command_requested.emit("end_record", {})
            return
        folder = new_files_folder(self.folder.text()) / f"by-hand-{time_stamp()}"
        args = {"out": str(folder), "note": self.note.text().strip()}
        self.command_requested.emit("record", args)


class Action(NamedTuple):
    """A button: the engine's command, the text, the event that must be possible, the tooltip."""

    command: str
    text: str
    event: StateEvent
    tooltip: str


ARM = Action("arm", "Arm", StateEvent.ARM, "Lift the drum and switch the motors on")
DISARM = Action("disarm", "Disarm", StateEvent.DISARM, "Switch the motors off")
TARE = Action(
    "tare", "Tare", StateEvent.MOVE, "Set the load cell's reading of the lifted drum to 0 g"
)
HOME = Action("home", "Home", StateEvent.MOVE, "Turn the lifted drum to its index mark")
TEST = Action(
    "test_taxels",
    "Taxel test",
    StateEvent.STOP,
    "Find broken lines, inputs and taxels; nothing may touch the sensor; the log lists the results",
)
APPROACH = Action(
    "approach", "Approach", StateEvent.APPROACH, "Press until the drum holds the set force"
)
RUN = Action("run", "Run", StateEvent.RUN, "Turn the drum over the plate once at the set speed")
RETRACT = Action("retract", "Retract", StateEvent.RETRACT, "Slow down and lift the drum")
ARM_FIRST = "Arm first: the drum may rest on the sensor, and arming lifts it"
RETRACT_FIRST = "Retract first: the drum presses on the sensor"
TARE_FIRST = "Tare first: without a zero the drum cannot hold a force"
APPROACH_FIRST = "Approach first, and wait for HOLD: the drum turns while it presses"
CLEAR = Action(
    "clear_fault", "Clear fault", StateEvent.CLEAR, "Clear the fault after its cause is removed"
)
ACTIONS = (ARM, DISARM, HOME, TARE, TEST, APPROACH, RUN, RETRACT, CLEAR)


def _tare_tooltip(status: EngineStatus) -> str:
    if not status.contact_may_stand:
        return TARE.tooltip
    presses = status.state in (State.APPROACH, State.HOLD, State.RUN)
    return RETRACT_FIRST if presses else ARM_FIRST


def is_possible(action: Action, status: EngineStatus) -> bool:
    """Return whether the command would change something now, and no protocol runs."""
    if action is TEST:
        return status.taxels_connected and not status.run.is_active
    if status.state is None or not status.drum_connected or status.run.is_active:
        return False
    if action is TARE:
        return status.state in (State.IDLE, State.ARMED) and not status.contact_may_stand
    if (action is APPROACH and not status.tared) or (action is CLEAR and status.estop_pressed):
        return False
    return next_state(status.state, action.event) not in (None, status.state)


class StatusPart(Protocol):
    """A part of the panel."""

    def show_status(self, status: EngineStatus) -> None:
        """Show a status."""


class OperatePanel(QWidget):
    """Controls for one drum; emits engine commands, and shows what the engine reports."""

    command_requested = Signal(str, dict)
    """The engine's command and its arguments, as in every panel."""
    path_requested = Signal(object, object)
    """Kind of the path, and the function that takes the chosen one."""

    def __init__(self) -> None:
        super().__init__()
        emit = self.command_requested.emit
        self.buttons = {
            action.command: push_button(
                action.text, partial(emit, action.command, {}), action.tooltip
            )
            for action in ACTIONS
        }
        self.set_points, self.reading_box = SetPointBox(), ReadingBox()
        self.speed, self.force = self.set_points.speed, self.set_points.force
        self.set_button = self.set_points.set_button
        self.set_points.command_requested.connect(self.command_requested)
        self.fault = label("no fault", "muted", wraps=True)
        self.jog, self.bench = JogButtons(), BenchControls()
        self.jog.command_requested.connect(self.command_requested)
        self.bench.command_requested.connect(self.command_requested)
        self.bring_up, self.record_box = BringUpBox(), RecordBox()
        for box in (self.bring_up, self.record_box):
            box.command_requested.connect(self.command_requested)
        self.record_box.path_requested.connect(self.path_requested)
        self._parts: tuple[StatusPart, ...] = (
            *(self.set_points, self.reading_box, self.jog, self.bench),
            *(self.bring_up, self.record_box),
        )
        self._lay_out()
        self.show_nothing()

    def show_nothing(self) -> None:
        """Disable everything: there is no rig."""
        self.show_status(EngineStatus())
        for box in (self.reading_box, self.set_points):
            box.show_nothing()
        self.jog.finish()

    def finish_command(self, command: str) -> None:
        """End a command that the engine has executed or refused."""
        if command == "jog":
            self.jog.finish()

    def show_status(self, status: EngineStatus) -> None:
        """Enable the commands that are possible and show the drum's readings."""
        for action in ACTIONS:
            self.buttons[action.command].setEnabled(is_possible(action, status))
        is_untared = status.state is State.ARMED and not status.tared
        show_tooltip(self.buttons["approach"], TARE_FIRST if is_untared else APPROACH.tooltip)
        is_lifted = status.state in (State.ARMED, State.APPROACH)
        show_tooltip(self.buttons["run"], APPROACH_FIRST if is_lifted else RUN.tooltip)
        show_tooltip(self.buttons["tare"], _tare_tooltip(status))
        clear = RELEASE_FIRST if status.estop_pressed else CLEAR.tooltip
        show_tooltip(self.buttons["clear_fault"], clear)
        for part in self._parts:
            part.show_status(status)
        show_text(self.fault, status.fault_words if status.fault else "no fault")
        set_property(self.fault, "role", "bad" if status.fault else "muted")

    def show_ages(self, ages: DataAges) -> None:
        """Turn readings that are no longer live grey."""
        self.reading_box.show_ages(ages)

    def _lay_out(self) -> None:
        drum, grid = self._action_box("Drum", (ARM, DISARM, HOME, TARE, TEST))
        grid.addWidget(self.jog, grid.rowCount(), 0, 1, 3)
        contact, _ = self._action_box("Contact", (APPROACH, RUN, RETRACT))
        boxes = (
            *(self.bring_up, drum, self.set_points, contact, self._fault_box()),
            *(self.reading_box, self.record_box),
        )
        self.setLayout(vbox(*boxes, self.bench, spacing=4, margins=(6, 4, 6, 6), tall=-1))

    def _action_box(self, title: str, actions: tuple[Action, ...]) -> tuple[QGroupBox, QGridLayout]:
        box, grid = group_box(title, QGridLayout())
        for place, action in enumerate(actions):
            grid.addWidget(self.buttons[action.command], place // 3, place % 3)
        return box, grid

    def _fault_box(self) -> QGroupBox:
        box, row = group_box("Fault", QHBoxLayout())
        self.fault.setMinimumHeight(3 * self.fault.fontMetrics().height())
        self.fault.setAlignment(Qt.AlignmentFlag.AlignTop)
        row.addWidget(self.fault, 1)
        row.addWidget(self.buttons[CLEAR.command], 0, Qt.AlignmentFlag.AlignTop)
        return box
