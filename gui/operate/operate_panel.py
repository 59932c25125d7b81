"""The Operate tab: arm, jog, set-points, approach, run, retract, clear a fault."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple, Protocol

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QGridLayout, QGroupBox, QHBoxLayout, QWidget

from gui.alarm.alarms import RELEASE_FIRST
from gui.operate.bench_controls import BenchControls
from gui.operate.bring_up import BringUpBox
from gui.operate.jog import JogButtons
from gui.operate.readings import ReadingBox
from gui.operate.record_box import RecordBox
from gui.operate.set_points import SetPointBox
from gui.widgets.data_ages import DataAges
from gui.widgets.labels import label, set_property, show_text
from gui.widgets.layouts import group_box, push_button, vbox
from rigctl.acquisition.rpc.messages import EngineStatus
from rigctl.wire.drum.states import State, StateEvent, next_state


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
RANGE = Action(
    "calibrate_range",
    "Taxel range",
    StateEvent.STOP,
    "Measure each taxel's range over the next 10 s; traces and spikes are scaled to it",
)
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
ACTIONS = (ARM, DISARM, HOME, TARE, RANGE, TEST, APPROACH, RUN, RETRACT, CLEAR)


def _tare_tooltip(status: EngineStatus) -> str:
    if not status.contact_may_stand:
        return TARE.tooltip
    presses = status.state in (State.APPROACH, State.HOLD, State.RUN)
    return RETRACT_FIRST if presses else ARM_FIRST


def is_possible(action: Action, status: EngineStatus) -> bool:
    """Return whether the command would change something now, and no protocol runs."""
    if action is RANGE:
        return status.taxels_connected
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
        self.buttons["approach"].setToolTip(TARE_FIRST if is_untared else APPROACH.tooltip)
        is_lifted = status.state in (State.ARMED, State.APPROACH)
        self.buttons["run"].setToolTip(APPROACH_FIRST if is_lifted else RUN.tooltip)
        self.buttons["tare"].setToolTip(_tare_tooltip(status))
        clear = RELEASE_FIRST if status.estop_pressed else CLEAR.tooltip
        self.buttons["clear_fault"].setToolTip(clear)
        for part in self._parts:
            part.show_status(status)
        show_text(self.fault, status.fault_words if status.fault else "no fault")
        set_property(self.fault, "role", "bad" if status.fault else "muted")

    def show_ages(self, ages: DataAges) -> None:
        """Turn readings that are no longer live grey."""
        self.reading_box.show_ages(ages)

    def _lay_out(self) -> None:
        drum, grid = self._action_box("Drum", (ARM, DISARM, HOME, TARE, RANGE, TEST))
        grid.addWidget(self.jog, grid.rowCount(), 0, 1, 3)
        contact, _ = self._action_box("Contact", (APPROACH, RUN, RETRACT))
        boxes = (
            *(self.bring_up, drum, self.set_points, contact, self._fault_box()),
            *(self.reading_box, self.record_box),
        )
        column = vbox(*boxes, self.bench, spacing=4, margins=(6, 4, 6, 6))
        column.addStretch(1)
        self.setLayout(column)

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
