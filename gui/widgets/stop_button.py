"""STOP, at the top of the window and of each panel that floats before it."""

from __future__ import annotations

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QPushButton

_LEAST_WIDTH_PX, _LEAST_HEIGHT_PX = 150, 46


class StopButton(QPushButton):
    """Stops as it goes down; it takes no focus, so that no key but Esc presses it."""

    def __init__(self) -> None:
        super().__init__("STOP")
        self.setObjectName("stop")
        self.setMinimumSize(_LEAST_WIDTH_PX, _LEAST_HEIGHT_PX)
        self.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self.setToolTip("Stop and lift the drum, and end every run (Esc)")
