"""The Operate tab: arm, jog, set-points, approach, run, retract, clear a fault."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QDoubleSpinBox, QGridLayout, QGroupBox, QHBoxLayout, QLabel, QWidget

from gui.operate.bench_controls import BenchControls
from gui.operate.jog import JogButtons
from gui.widgets.labels import elastic, label, set_property, show_text
from gui.widgets.layouts import group_box, push_button, vbox
from rigctl.acquisition.rpc.messages import EngineStatus
from rigctl.wire.drum.register_table import BY_NAME
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
TARE_FIRST = "Tare first: without a zero the drum cannot hold a force"
CLEAR = Action(
    "clear_fault", "Clear fault", StateEvent.CLEAR, "Clear the fault after its cause is removed"
)
ACTIONS = (ARM, DISARM, HOME, TARE, RANGE, TEST, APPROACH, RUN, RETRACT, CLEAR)
_READINGS = ("Force", "Speed", "Actuator", "Angle", "Tared", "Homed")


def is_possible(action: Action, status: EngineStatus) -> bool:
    """Return whether the command would change something now, and no protocol runs."""
    if action is RANGE:
        return status.taxels_connected
    if action is TEST:
        return status.taxels_connected and not status.run.is_active
    if status.state is None or not status.drum_connected or status.run.is_active:
        return False
    if action is TARE:
        return status.state in (State.IDLE, State.ARMED)
    if action is APPROACH and not status.tared:
        return False
    return next_state(status.state, action.event) not in (None, status.state)


class OperatePanel(QWidget):
    """Controls for one drum; emits engine commands, and shows what the engine reports."""

    command_requested = Signal(str, dict)
    """The engine's command and its arguments, as in every panel."""

    def __init__(self) -> None:
        super().__init__()
        emit = self.command_requested.emit
        self.buttons = {
            action.command: push_button(
                action.text, partial(emit, action.command, {}), action.tooltip
            )
            for action in ACTIONS
        }
        self.speed = _register_spin_box("speed_set", " mm/s", 5.0)
        self.force = _register_spin_box("force_set", " g", 50.0)
        tooltip = "Send speed and force to the drum, which then reports them back"
        self.set_button = push_button("Set", self._send_set_points, tooltip)
        self.set_points = elastic(label("–", "muted"))
        self.readings = {name: elastic(label("–", "heading")) for name in _READINGS}
        self.fault = label("no fault", "muted", wraps=True)
        self.jog, self.bench = JogButtons(), BenchControls()
        self.jog.command_requested.connect(self.command_requested)
        self.bench.command_requested.connect(self.command_requested)
        self._lay_out()
        self.show_nothing()

    def show_nothing(self) -> None:
        """Disable everything: there is no rig."""
        self.show_status(EngineStatus())
        for reading in (*self.readings.values(), self.set_points):
            reading.setText("–")
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
        self.set_button.setEnabled(status.drum_connected and not status.run.is_active)
        self.jog.show_status(status)
        self.bench.show_status(status)
        show_text(self.fault, status.fault_words if status.fault else "no fault")
        set_property(self.fault, "role", "bad" if status.fault else "muted")
        if status.drum_connected:
            self._show_readings(status)

    def _show_readings(self, status: EngineStatus) -> None:
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
        show_text(self.set_points, f"{status.speed_set_mm_s:.1f} mm/s, {status.force_set_g:.0f} g")

    def _send_set_points(self) -> None:
        args = {"speed_mm_s": self.speed.value(), "force_g": self.force.value()}
        self.command_requested.emit("set", args)

    def _lay_out(self) -> None:
        drum, grid = self._action_box("Drum", (ARM, DISARM, HOME, TARE, RANGE, TEST))
        grid.addWidget(self.jog, grid.rowCount(), 0, 1, 3)
        contact, _ = self._action_box("Contact", (APPROACH, RUN, RETRACT))
        boxes = (drum, self._set_point_box(), contact, self._fault_box(), self._reading_box())
        column = vbox(*boxes, self.bench, spacing=4, margins=(6, 4, 6, 6))
        column.addStretch(1)
        self.setLayout(column)

    def _action_box(self, title: str, actions: tuple[Action, ...]) -> tuple[QGroupBox, QGridLayout]:
        box, grid = group_box(title, QGridLayout())
        for place, action in enumerate(actions):
            grid.addWidget(self.buttons[action.command], place // 3, place % 3)
        return box, grid

    def _set_point_box(self) -> QGroupBox:
        box, grid = group_box("Set-points", QGridLayout())
        for row, (name, spin_box) in enumerate((("Speed", self.speed), ("Force", self.force))):
            grid.addWidget(QLabel(name), row, 0)
            grid.addWidget(spin_box, row, 1)
            limits = f"{spin_box.minimum():.0f}–{spin_box.maximum():.0f}{spin_box.suffix()}"
            grid.addWidget(label(limits, "muted"), row, 2)
        grid.addWidget(label("In use", "muted"), 2, 0)
        grid.addWidget(self.set_points, 2, 1)
        grid.addWidget(self.set_button, 2, 2)
        grid.setColumnStretch(1, 1)
        return box

    def _fault_box(self) -> QGroupBox:
        box, row = group_box("Fault", QHBoxLayout())
        self.fault.setMinimumHeight(3 * self.fault.fontMetrics().height())
        self.fault.setAlignment(Qt.AlignmentFlag.AlignTop)
        row.addWidget(self.fault, 1)
        row.addWidget(self.buttons[CLEAR.command], 0, Qt.AlignmentFlag.AlignTop)
        return box

    def _reading_box(self) -> QGroupBox:
        box, grid = group_box("Readings", QGridLayout())
        grid.setVerticalSpacing(2)
        for place, (name, reading) in enumerate(self.readings.items()):
            grid.addWidget(label(name, "muted"), place // 2, place % 2 * 2)
            grid.addWidget(reading, place // 2, place % 2 * 2 + 1)
        grid.setColumnStretch(1, 1)
        grid.setColumnStretch(3, 1)
        return box


def _register_spin_box(register_name: str, suffix: str, step: float) -> QDoubleSpinBox:
    """Return a field with the limits and the default of the board's register."""
    register = BY_NAME[register_name]
    spin_box = QDoubleSpinBox(
        minimum=register.low * register.scale,
        maximum=register.high * register.scale,
        value=register.default * register.scale,
        suffix=suffix,
        singleStep=step,
        decimals=1 if register.scale < 0.1 else 0,
    )
    spin_box.setAlignment(Qt.AlignmentFlag.AlignRight)
    return spin_box
