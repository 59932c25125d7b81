"""Buttons and keys that jog the lifted drum."""

from __future__ import annotations

from PySide6.QtCore import Signal
from PySide6.QtGui import QKeySequence, QShortcut
from PySide6.QtWidgets import QHBoxLayout, QPushButton, QWidget

from gui.widgets.labels import label
from rigctl.acquisition.rpc.messages import EngineStatus
from rigctl.wire.drum.states import State

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
            button.setToolTip(_tooltip(mm, obstacle))

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
