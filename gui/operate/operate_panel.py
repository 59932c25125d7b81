"""Working the rig by hand: arm, jog, set-points, approach, run, retract, clear a fault."""

from __future__ import annotations

from typing import NamedTuple

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import (
    QDoubleSpinBox,
    QGridLayout,
    QGroupBox,
    QHBoxLayout,
    QLabel,
    QPushButton,
    QVBoxLayout,
    QWidget,
)

from gui.operate.bench_controls import BenchControls
from gui.operate.jog import JogButtons
from gui.widgets.formatting import fault_sentence
from gui.widgets.labels import elastic, label, set_property, show_text
from rigctl.acquisition.rpc.messages import EngineStatus
from rigctl.wire.drum.register_table import BY_NAME
from rigctl.wire.drum.states import State, StateEvent, next_state


class Action(NamedTuple):
    """A button: the engine's command, what it says, the event that must be possible, a hint."""

    command: str
    text: str
    event: StateEvent
    hint: str


ARM = Action("arm", "Arm", StateEvent.ARM, "Lift the drum and switch the motors on")
DISARM = Action("disarm", "Disarm", StateEvent.DISARM, "Switch the motors off")
TARE = Action("tare", "Tare", StateEvent.MOVE, "Take the load cell's reading, lifted, as 0 g")
HOME = Action("home", "Home", StateEvent.MOVE, "Turn, lifted, to the drum's index mark")
RANGE = Action(
    "calibrate_range",
    "Taxel range",
    StateEvent.STOP,
    "Take what the taxels show in the next 10 s as their range for traces and spikes",
)
TEST = Action(
    "test_taxels",
    "Taxel test",
    StateEvent.STOP,
    "Look for broken lines and taxels, with nothing on the sensor; the log says what was found",
)
APPROACH = Action(
    "approach", "Approach", StateEvent.APPROACH, "Press on until the set force is held"
)
RUN = Action("run", "Run", StateEvent.RUN, "Turn the drum once over the plate at the set speed")
RETRACT = Action("retract", "Retract", StateEvent.RETRACT, "Slow down and lift")
TARE_FIRST = "Tare first: without a zero no force can be held"
CLEAR = Action("clear_fault", "Clear fault", StateEvent.CLEAR, "Once the cause is gone")
ACTIONS = (ARM, DISARM, HOME, TARE, RANGE, TEST, APPROACH, RUN, RETRACT, CLEAR)


def is_possible(action: Action, status: EngineStatus) -> bool:
    """Whether the command would change something now, and no protocol has the rig."""
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
    """Emits commands by name; what the board refuses is said in the status line."""

    asked = Signal(str)
    set_asked = Signal(float, float)
    plate_asked = Signal(str)
    inject_asked = Signal(str, dict)

    def __init__(self) -> None:
        super().__init__()
        self.buttons = {action.command: self._button(action) for action in ACTIONS}
        self.speed = _spin("speed_set", " mm/s", 5.0)
        self.force = _spin("force_set", " g", 50.0)
        self.apply = QPushButton("Set")
        self.apply.setToolTip("Send speed and force to the drum; the answer is shown above")
        self.apply.clicked.connect(self._set_clicked)
        self.read_back = elastic(label("–", "muted"))
        self.now = {name: elastic(label("–", "heading")) for name in _NOW}
        self.fault = label("no fault", "muted", wraps=True)
        self.jog = JogButtons()
        self.bench = BenchControls()
        self.bench.plate_asked.connect(self.plate_asked)
        self.bench.inject_asked.connect(self.inject_asked)
        self._lay_out()
        self.show_nothing()

    def show_nothing(self) -> None:
        """No rig: nothing can be asked for."""
        self.show_status(EngineStatus())
        for shown in self.now.values():
            shown.setText("–")
        self.read_back.setText("–")

    def show_status(self, status: EngineStatus) -> None:
        """Enable what is possible, show what is."""
        for action in ACTIONS:
            self.buttons[action.command].setEnabled(is_possible(action, status))
        untared = status.state is State.ARMED and not status.tared
        self.buttons["approach"].setToolTip(TARE_FIRST if untared else APPROACH.hint)
        self.apply.setEnabled(status.drum_connected and not status.run.is_active)
        self.jog.show_status(status)
        self.bench.show_status(status)
        sentence = status.fault_words if status.fault else "no fault"
        show_text(self.fault, sentence or fault_sentence(status.fault))
        set_property(self.fault, "role", "bad" if status.fault else "muted")
        if status.drum_connected:
            self._show_numbers(status)

    def _show_numbers(self, status: EngineStatus) -> None:
        self.now["Force"].setText(f"{status.force_g:.1f} g")
        self.now["Speed"].setText(f"{status.speed_mm_s:.1f} mm/s")
        self.now["Angle"].setText(f"{status.angle_deg:.1f} °")
        self.now["Actuator"].setText(f"{status.actuator_position_um / 1000:.2f} mm")
        self.now["Tared"].setText("yes" if status.tared else "no")
        self.now["Homed"].setText("yes" if status.homed else "no")
        show_text(self.read_back, f"{status.speed_set_mm_s:.1f} mm/s, {status.force_set_g:.0f} g")

    def _set_clicked(self) -> None:
        self.set_asked.emit(self.speed.value(), self.force.value())

    def _button(self, action: Action) -> QPushButton:
        button = QPushButton(action.text)
        button.setToolTip(action.hint)
        button.clicked.connect(lambda: self.asked.emit(action.command))
        return button

    def _lay_out(self) -> None:
        column = QVBoxLayout(self)
        column.setContentsMargins(6, 4, 6, 6)
        column.setSpacing(4)
        column.addWidget(self._drum_box())
        column.addWidget(self._set_points())
        column.addWidget(self._actions("Contact", (APPROACH, RUN, RETRACT)))
        column.addWidget(self._fault_box())
        column.addWidget(self._now_box())
        column.addWidget(self.bench)
        column.addStretch(1)

    def _drum_box(self) -> QGroupBox:
        box = self._actions("Drum", (ARM, DISARM, HOME, TARE, RANGE, TEST))
        grid = box.layout()
        assert isinstance(grid, QGridLayout)
        grid.addWidget(self.jog, grid.rowCount(), 0, 1, 3)
        return box

    def _actions(self, title: str, actions: tuple[Action, ...]) -> QGroupBox:
        box = QGroupBox(title)
        grid = QGridLayout(box)
        grid.setContentsMargins(8, 6, 8, 8)
        for place, action in enumerate(actions):
            grid.addWidget(self.buttons[action.command], place // 3, place % 3)
        return box

    def _set_points(self) -> QGroupBox:
        box = QGroupBox("Set-points")
        grid = QGridLayout(box)
        grid.setContentsMargins(8, 6, 8, 8)
        for row, (name, spin) in enumerate((("Speed", self.speed), ("Force", self.force))):
            grid.addWidget(QLabel(name), row, 0)
            grid.addWidget(spin, row, 1)
            low, high = spin.minimum(), spin.maximum()
            grid.addWidget(label(f"{low:.0f}–{high:.0f}", "muted"), row, 2)
        grid.addWidget(label("Drum has", "muted"), 2, 0)
        grid.addWidget(self.read_back, 2, 1)
        grid.addWidget(self.apply, 2, 2)
        grid.setColumnStretch(1, 1)
        return box

    def _fault_box(self) -> QGroupBox:
        box = QGroupBox("Fault")
        row = QHBoxLayout(box)
        row.setContentsMargins(8, 6, 8, 8)
        self.fault.setMinimumHeight(3 * self.fault.fontMetrics().height())
        self.fault.setAlignment(Qt.AlignmentFlag.AlignTop)
        row.addWidget(self.fault, 1)
        row.addWidget(self.buttons[CLEAR.command], 0, Qt.AlignmentFlag.AlignTop)
        return box

    def _now_box(self) -> QGroupBox:
        box = QGroupBox("Now")
        grid = QGridLayout(box)
        grid.setContentsMargins(8, 6, 8, 8)
        grid.setVerticalSpacing(2)
        for place, (name, shown) in enumerate(self.now.items()):
            grid.addWidget(label(name, "muted"), place // 2, place % 2 * 2)
            grid.addWidget(shown, place // 2, place % 2 * 2 + 1)
        grid.setColumnStretch(1, 1)
        grid.setColumnStretch(3, 1)
        return box


_NOW = ("Force", "Speed", "Actuator", "Angle", "Tared", "Homed")


def _spin(register_name: str, suffix: str, step: float) -> QDoubleSpinBox:
    """A box with the limits that the board itself enforces, starting at its default."""
    register = BY_NAME[register_name]
    spin = QDoubleSpinBox()
    spin.setRange(register.low * register.scale, register.high * register.scale)
    spin.setValue(register.default * register.scale)
    spin.setSuffix(suffix)
    spin.setSingleStep(step)
    spin.setDecimals(1 if register.scale < 0.1 else 0)
    spin.setAlignment(Qt.AlignmentFlag.AlignRight)
    return spin
