"""The key that stops: Esc, with every focus."""

from __future__ import annotations

from PySide6.QtCore import QEvent, QObject, Qt, QTimer, Signal
from PySide6.QtGui import QKeyEvent
from PySide6.QtWidgets import QApplication, QWidget


class EscapeKey(QObject):
    """Reports one press of Esc once; an open menu or list still gets the key and closes."""

    pressed = Signal()

    def __init__(self, parent: QObject) -> None:
        super().__init__(parent)
        self._is_down = False
        self._app = QApplication.instance()
        assert self._app is not None
        self._app.installEventFilter(self)

    def release(self) -> None:
        """Leave the key to other windows of this process."""
        assert self._app is not None
        self._app.removeEventFilter(self)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Take Esc before the widget with the focus gets it."""
        if not isinstance(event, QKeyEvent) or event.key() != Qt.Key.Key_Escape:
            return False
        if event.type() == QEvent.Type.KeyRelease:
            self._is_down = False
        if event.type() != QEvent.Type.KeyPress or not isinstance(watched, QWidget):
            return False
        if not event.isAutoRepeat():
            self._report_once()
        return QApplication.activePopupWidget() is None

    def _report_once(self) -> None:
        """Report one press once: Qt passes the key of an open list to its parents as well."""
        if not self._is_down:
            self._is_down = True
            QTimer.singleShot(0, self._forget)
            self.pressed.emit()

    def _forget(self) -> None:
        self._is_down = False
