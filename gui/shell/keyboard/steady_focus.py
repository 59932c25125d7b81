"""A window in which a key presses only what the user chose: the focus never jumps by itself."""

from __future__ import annotations

from PySide6.QtCore import QEvent, QObject, Qt
from PySide6.QtGui import QKeyEvent
from PySide6.QtWidgets import (
    QApplication,
    QDockWidget,
    QMainWindow,
    QPushButton,
    QScrollArea,
    QWidget,
)
from shiboken6 import isValid

_PRESS_KEYS = (Qt.Key.Key_Return, Qt.Key.Key_Enter)
_BY_KEY = Qt.FocusReason.ShortcutFocusReason
"""Qt then shows where the focus is; for Tab's reason it does so only while Tab is pressed."""
_REASONS = {True: Qt.FocusReason.TabFocusReason, False: Qt.FocusReason.BacktabFocusReason}


class SteadyFocusWindow(QMainWindow):
    """Rests the focus when its control goes off or disappears, and gives it back later.

    Qt moves the focus of a button that goes off to the next one. A second press of the same key
    would then press that: Run after Approach, Abort after Pause. Return presses a button as the
    space bar does.
    """

    def __init__(self) -> None:
        super().__init__()
        self._left: QWidget | None = None

    def focusNextPrevChild(self, is_next: bool) -> bool:
        """Move the focus to the next control on the screen; from one that has gone, rest it first.

        Qt leads through the panels behind the front one, too, where nobody sees the focus.
        """
        focus = self.focusWidget()
        if focus is not None and not (focus.isEnabled() and focus.isVisible()):
            self._leave(focus)
            return True
        if focus in (None, self) and self._left is not None and isValid(self._left):
            focus = self._left
        found = neighbour_of(self, focus, is_next=is_next)
        if found is None:
            return super().focusNextPrevChild(is_next)
        give_focus(found, _REASONS[is_next])
        return True

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Let Return press the button that has the focus."""
        focus = QApplication.focusWidget()
        is_press = event.key() in _PRESS_KEYS and not event.isAutoRepeat()
        if is_press and isinstance(focus, QPushButton):
            focus.click()
        else:
            super().keyPressEvent(event)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Give the focus back to the control that had it, once it can be used again."""
        left = self._left
        if watched is left and event.type() in (QEvent.Type.EnabledChange, QEvent.Type.Show):
            rests = self.focusWidget() in (self, None)
            if left is not None and left.isEnabled() and left.isVisible() and rests:
                left.setFocus(_BY_KEY)
        return super().eventFilter(watched, event)

    def _leave(self, focus: QWidget) -> None:
        if self._left is not None and isValid(self._left):
            self._left.removeEventFilter(self)
        self._left = focus
        focus.installEventFilter(self)
        self.setFocus(Qt.FocusReason.OtherFocusReason)


def neighbour_of(region: QWidget, start: QWidget | None, *, is_next: bool = True) -> QWidget | None:
    """Return the control of a region that Tab reaches from ``start``, None without one.

    Controls follow each other as they were added, which is how they are laid out.
    """
    controls = region.findChildren(QWidget)
    at = controls.index(start) if start in controls else -1
    after = [*controls[at + 1 :], *controls[: max(at, 0)]]
    found = (widget for widget in (after if is_next else reversed(after)) if _takes_tab(widget))
    return next(found, None)


def give_focus(widget: QWidget, reason: Qt.FocusReason = _BY_KEY) -> None:
    """Give a widget the focus, and scroll its panel until the widget is in view."""
    widget.setFocus(reason)
    area = _above(widget, QScrollArea)
    if isinstance(area, QScrollArea):
        area.ensureWidgetVisible(widget)


def _takes_tab(widget: QWidget) -> bool:
    policy = Qt.FocusPolicy.TabFocus
    can_be_used = widget.isEnabled() and widget.isVisible() and widget.focusProxy() is None
    if not can_be_used or widget.focusPolicy() & policy != policy:
        return False
    dock = _above(widget, QDockWidget)
    return dock is None or not dock.visibleRegion().isEmpty()


def _above(widget: QWidget, kind: type[QWidget]) -> QWidget | None:
    """Return the closest widget of a kind in which a widget is, None without one."""
    above = widget.parentWidget()
    while above is not None and not isinstance(above, kind):
        above = above.parentWidget()
    return above
