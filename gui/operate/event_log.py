"""The event log, newest line at the bottom, and the line that shows the latest event."""

from __future__ import annotations

from collections import deque
from html import escape
from typing import NamedTuple

from PySide6.QtCore import QElapsedTimer, QTime, QTimer
from PySide6.QtWidgets import QPlainTextEdit

from gui.widgets.labels import ElidedLabel, set_property, show_text
from gui.widgets.theme import applied_theme

MAX_LINES = 2000
ERROR_HOLD_MS = 8000
RED_MS = 30_000
ERROR_KINDS = frozenset(
    {"fault", "refused", "lost", "link", "gap", "disk", "failed", "stop", "check", "contact"}
)


class LogLine(NamedTuple):
    """The time of day, the kind of the event and its text."""

    time: str
    kind: str
    text: str


class EventLog(QPlainTextEdit):
    """A read-only log; each line begins with the time at which the window got the event."""

    def __init__(self) -> None:
        super().__init__(readOnly=True, maximumBlockCount=MAX_LINES)
        self.setMinimumHeight(48)
        self._lines: deque[LogLine] = deque(maxlen=MAX_LINES)

    def reset_colours(self) -> None:
        """Show the present lines in the colours of another theme."""
        super().clear()
        for line in self._lines:
            self._show(line)

    def add(self, kind: str, text: str, at: QTime | None = None) -> None:
        """Append an event of now or ``at`` a time; errors get the theme's colour for them."""
        line = LogLine((at or QTime.currentTime()).toString("HH:mm:ss"), kind, text)
        self._lines.append(line)
        self._show(line)

    def clear(self) -> None:
        """Remove all lines."""
        self._lines.clear()
        super().clear()

    def _show(self, line: LogLine) -> None:
        theme = applied_theme()
        colour = theme.bad if line.kind in ERROR_KINDS else theme.text
        self.appendHtml(
            f'<span style="color:{theme.muted}">{line.time}&nbsp;&nbsp;{escape(line.kind)}&nbsp;'
            f'</span> <span style="color:{colour}">{escape(line.text)}</span>'
        )


class StatusLine(ElidedLabel):
    """The latest event; an error stays for a while unless another error follows.

    An error that nothing has replaced loses its red: the log keeps it, with its time. A text that
    is too long ends in an ellipsis; :meth:`text`, the tooltip and the log have all of it.
    """

    def __init__(self, text: str) -> None:
        super().__init__(text, "muted")
        self._since_error = QElapsedTimer()
        self.red_timer = QTimer(self, singleShot=True, interval=RED_MS)
        self.red_timer.timeout.connect(lambda: set_property(self, "role", "muted"))

    def show_event(self, kind: str, text: str) -> None:
        """Show an event unless a recent error is more important."""
        is_error = kind in ERROR_KINDS
        if is_error:
            self._since_error.start()
            self.red_timer.start()
        elif self._since_error.isValid() and not self._since_error.hasExpired(ERROR_HOLD_MS):
            return
        show_text(self, text)
        set_property(self, "role", "bad" if is_error else "muted")
