"""Boxes that the wheel changes only with the focus: scrolling past one must not move hardware."""

from __future__ import annotations

from typing import TypeVar

from PySide6.QtCore import QEvent, QObject, Qt
from PySide6.QtWidgets import QAbstractSpinBox, QComboBox, QWidget

_Box = TypeVar("_Box", bound=QComboBox | QAbstractSpinBox)


class WheelFilter(QObject):
    """Leaves the wheel over a box without the focus to what scrolls behind the box."""

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Keep the wheel from a box without the focus."""
        if event.type() != QEvent.Type.Wheel or not isinstance(watched, QWidget):
            return False
        if watched.hasFocus():
            return False
        event.ignore()
        return True


def focus_wheel(box: _Box) -> _Box:
    """Return a box that ignores the wheel without the focus, and gets none from the wheel."""
    box.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
    box.installEventFilter(WheelFilter(box))
    return box
