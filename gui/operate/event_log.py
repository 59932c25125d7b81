"""The event log, newest line at the bottom, and the line that shows the latest event."""

from __future__ import annotations

from html import escape

from PySide6.QtCore import QElapsedTimer, QTime
from PySide6.QtWidgets import QLabel, QPlainTextEdit

from gui.widgets.labels import elastic, set_property, show_text
from gui.widgets.theme import applied_theme

MAX_LINES = 2000
ERROR_HOLD_MS = 8000
ERROR_KINDS = frozenset(
    {"fault", "refused", "lost", "link", "gap", "disk", "failed", "stop", "check"}
)


class EventLog(QPlainTextEdit):
    """A read-only log; each line begins with the time at which the window got the event."""

    def __init__(self) -> None:
        super().__init__(readOnly=True, maximumBlockCount=MAX_LINES)
        self.setMinimumHeight(64)

    def reset_colours(self) -> None:
        """Show the present lines without the colours of another theme."""
        self.setPlainText(self.toPlainText())
        self.moveCursor(self.textCursor().MoveOperation.End)

    def add(self, kind: str, text: str) -> None:
        """Append an event; errors get the theme's colour for them."""
        theme = applied_theme()
        time = QTime.currentTime().toString("HH:mm:ss")
        colour = theme.bad if kind in ERROR_KINDS else theme.text
        self.appendHtml(
            f'<span style="color:{theme.muted}">{time}&nbsp;&nbsp;{escape(kind)}&nbsp;'
            f'</span> <span style="color:{colour}">{escape(text)}</span>'
        )


class StatusLine(QLabel):
    """The latest event; an error stays for a while unless another error follows."""

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self.setProperty("role", "muted")
        elastic(self)
        self._since_error = QElapsedTimer()

    def show_event(self, kind: str, text: str) -> None:
        """Show an event unless a recent error is more important."""
        is_error = kind in ERROR_KINDS
        if is_error:
            self._since_error.start()
        elif self._since_error.isValid() and not self._since_error.hasExpired(ERROR_HOLD_MS):
            return
        show_text(self, text)
        set_property(self, "role", "bad" if is_error else "muted")
