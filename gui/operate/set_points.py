"""Set-points: what is asked beside what the drum has, within the limits of the rig."""

from __future__ import annotations

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QGridLayout, QGroupBox, QLabel

from gui.widgets.focus_wheel import focus_wheel
from gui.widgets.labels import label, set_property, show_text
from gui.widgets.layouts import push_button
from gui.widgets.number_box import NumberBox, has_refused
from rigctl.acquisition.rpc.messages import EngineStatus
from rigctl.config.rig_config import RigLimits
from rigctl.wire.drum.register_table import BY_NAME
from rigctl.wire.drum.states import State

SPEED_LATER = "The drum turns: its speed can be set once it holds still or is lifted"
_TIP = "Send speed and force to the drum, which then reports what it has"


class SetPointBox(QGroupBox):
    """Speed and force: asked, and what the drum has; the ranges are those of ``rig.toml``."""

    command_requested = Signal(str, dict)

    def __init__(self) -> None:
        super().__init__("Set-points")
        self.speed = _register_spin_box("speed_set", " mm/s", 5.0)
        self.force = _register_spin_box("force_set", " g", 50.0)
        self.drum_speed, self.drum_force = label("–"), label("–")
        self.allowed = label("", "muted", wraps=True)
        self.set_button = push_button("Set", self._send, _TIP)
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
        if status.drum_connected:
            self.set_limits(status.limits)
            self._drum = (status.speed_set_mm_s, status.force_set_g)
            self._turns = status.state is State.RUN
            self._show_allowed()
            self._show_drum()

    def show_nothing(self) -> None:
        """Forget what the drum had."""
        self._drum = None
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
