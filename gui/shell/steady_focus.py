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


class SteadyFocus(QObject):
    """Rests the focus of a window when its control goes off or disappears; gives it back later.

    Qt moves the focus of a button that goes off to the next one. A second press of the same key
    would then press that: Run after Approach, Abort after Pause.
    """

    def __init__(self, window: QWidget) -> None:
        super().__init__(window)
        self._window = window
        self._left: QWidget | None = None

    def move(self, *, is_next: bool) -> bool:
        """Move the focus to the next control on the screen; from one that has gone, rest it first.

        Return whether there is another control. Qt leads through the panels behind the front one,
        too, where nobody sees the focus.
        """
        focus = self._window.focusWidget()
        if focus is not None and not (focus.isEnabled() and focus.isVisible()):
            self._leave(focus)
            return True
        if focus in (None, self._window) and self._left is not None and isValid(self._left):
            focus = self._left
        found = neighbour_of(self._window, focus, is_next=is_next)
        if found is None:
            return False
        give_focus(found, _REASONS[is_next])
        return True

    def press(self, event: QKeyEvent) -> bool:
        """Let Return press the button that has the focus, as the space bar does."""
        focus = QApplication.focusWidget()
        is_press = event.key() in _PRESS_KEYS and not event.isAutoRepeat()
        if not is_press or not isinstance(focus, QPushButton):
            return False
        focus.click()
        return True

    def rest(self) -> None:
        """Give the focus to the window itself, where no key presses anything."""
        self._window.setFocus(Qt.FocusReason.OtherFocusReason)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Give the focus back to the control that had it, once it can be used again."""
        left = self._left
        if watched is left and event.type() in (QEvent.Type.EnabledChange, QEvent.Type.Show):
            rests = self._window.focusWidget() in (self._window, None)
            can_be_used = left.isEnabled() and left.isVisible() and left.window() is self._window
            if can_be_used and rests:
                left.setFocus(_BY_KEY)
        return super().eventFilter(watched, event)

    def _leave(self, focus: QWidget) -> None:
        if self._left is not None and isValid(self._left):
            self._left.removeEventFilter(self)
        self._left = focus
        focus.installEventFilter(self)
        self.rest()


class SteadyFocusWindow(QMainWindow):
    """A window with a :class:`SteadyFocus`."""

    def __init__(self) -> None:
        super().__init__()
        self._steady_focus = SteadyFocus(self)

    def focusNextPrevChild(self, is_next: bool) -> bool:
        """Move the focus as :class:`SteadyFocus` does."""
        return self._steady_focus.move(is_next=is_next) or super().focusNextPrevChild(is_next)

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Let Return press the button that has the focus."""
        if not self._steady_focus.press(event):
            super().keyPressEvent(event)


class SteadyFocusDock(QDockWidget):
    """A dock that has a :class:`SteadyFocus` of its own while it is a window of its own."""

    def __init__(self, title: str) -> None:
        super().__init__(title)
        self._steady_focus = SteadyFocus(self)
        self.topLevelChanged.connect(self._begin)

    def focusNextPrevChild(self, is_next: bool) -> bool:
        """Move the focus within the floating dock; a docked one leaves that to its window."""
        floats = self.isWindow()
        return (floats and self._steady_focus.move(is_next=is_next)) or super().focusNextPrevChild(
            is_next
        )

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Let Return press the button that has the focus in the floating dock."""
        if not (self.isWindow() and self._steady_focus.press(event)):
            super().keyPressEvent(event)

    def _begin(self, floats: bool) -> None:
        """Rest the focus of a new window: Qt would give it to the first button."""
        if floats and self.focusWidget() is None:
            self._steady_focus.rest()


def neighbour_of(region: QWidget, start: QWidget | None, *, is_next: bool = True) -> QWidget | None:
    """Return the control of a region that Tab reaches from ``start``, None without one.

    Controls follow each other as they were added, which is how they are laid out.
    """
    controls = region.findChildren(QWidget)
    at = controls.index(start) if start in controls else -1
    after = [*controls[at + 1 :], *controls[: max(at, 0)]]
    window = region.window()  # a floating panel is a window of its own
    found = (
        widget
        for widget in (after if is_next else reversed(after))
        if _takes_tab(widget) and widget.window() is window
    )
    return next(found, None)


def give_focus(widget: QWidget, reason: Qt.FocusReason = _BY_KEY) -> None:
    """Give a widget the focus, and scroll its panel until the widget is in view."""
    widget.setFocus(reason)
    if QApplication.activeWindow() is not None and not widget.isActiveWindow():
        widget.activateWindow()
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
