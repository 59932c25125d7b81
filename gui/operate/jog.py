"""Turning the lifted drum by hand: four buttons, and Alt with the arrow keys."""

from __future__ import annotations

from PySide6.QtCore import Signal
from PySide6.QtGui import QKeySequence, QShortcut
from PySide6.QtWidgets import QHBoxLayout, QPushButton, QWidget

from gui.widgets.labels import label
from rigctl.acquisition.rpc.messages import EngineStatus
from rigctl.wire.drum.states import State

STEPS_MM = {-10: "Alt+Shift+Left", -1: "Alt+Left", 1: "Alt+Right", 10: "Alt+Shift+Right"}
"""Texture travel of each button, and its keys."""

_WHY_NOT = {
    State.IDLE: "arm the drum first",
    State.POSITION: "the drum is moving",
    State.RETRACT: "the drum is lifting off",
    State.APPROACH: "retract first: the drum is pressing",
    State.HOLD: "retract first: the drum is in contact",
    State.RUN: "retract first: the drum is in contact",
    State.FAULT_LIFT: "clear the fault first",
    State.FAULT_OFF: "clear the fault first",
}


def why_not(status: EngineStatus) -> str:
    """Why the drum cannot be jogged now; empty where it can."""
    if not status.drum_connected or status.state is None:
        return "no drum is connected"
    if status.run.is_active:
        return "a protocol has the rig"
    if status.state is State.ARMED:
        return ""
    return _WHY_NOT.get(status.state, "the drum is starting")


class JogButtons(QWidget):
    """Emits mm of texture travel; one jog at a time, so that two clicks are never one too many."""

    asked = Signal(float)

    def __init__(self) -> None:
        super().__init__()
        self.buttons = {mm: self._button(mm, keys) for mm, keys in STEPS_MM.items()}
        self._why_not = "no drum is connected"
        self._is_asked = False
        self._focused: QPushButton | None = None
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.setSpacing(4)
        row.addWidget(label("Jog", "muted"))
        for button in self.buttons.values():
            row.addWidget(button, 1)
        row.addWidget(label("mm", "muted"))
        self._show()

    def show_status(self, status: EngineStatus) -> None:
        """Enable what is possible, else say why it is not."""
        self._why_not = why_not(status)
        self._show()

    def ended(self) -> None:
        """The engine answered: the drum stands, or the jog was refused."""
        self._is_asked = False
        self._show()

    def _ask(self, mm: int) -> None:
        self._is_asked = True
        self._show()
        self.asked.emit(float(mm))

    def _show(self) -> None:
        reason = self._why_not or ("the drum is moving" if self._is_asked else "")
        self._keep_focus(bool(reason))
        for mm, button in self.buttons.items():
            button.setEnabled(not reason)
            button.setToolTip(_hint(mm, reason))
        if self._focused is not None and self.hasFocus() and not reason:
            self._focused.setFocus()

    def _keep_focus(self, disabling: bool) -> None:
        """A disabled button gives its focus away; the next key must not press another one."""
        for button in self.buttons.values():
            if disabling and button.hasFocus():
                self._focused = button
                self.setFocus()

    def _button(self, mm: int, keys: str) -> QPushButton:
        button = QPushButton(f"{mm:+d}".replace("-", "−"))
        button.setMinimumWidth(30)
        button.setAccessibleName(f"Jog {mm:+d} mm")
        button.clicked.connect(lambda: self._ask(mm))
        shortcut = QShortcut(QKeySequence(keys), self)
        shortcut.setAutoRepeat(False)
        shortcut.activated.connect(button.click)
        return button


def _hint(mm: int, reason: str) -> str:
    way = "forwards, as a forward trial does" if mm > 0 else "backwards"
    hint = f"Turn the lifted drum {abs(mm)} mm of texture {way} ({STEPS_MM[mm]})"
    return f"{hint}. Not now: {reason}" if reason else hint
