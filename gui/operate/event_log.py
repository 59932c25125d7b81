"""The log: what happened, newest at the bottom, one sentence a line."""

from __future__ import annotations

from html import escape

from PySide6.QtCore import QTime
from PySide6.QtWidgets import QPlainTextEdit

from gui.widgets.theme import Theme

LINES_KEPT = 2000
BAD_KINDS = frozenset(
    {"fault", "refused", "lost", "link", "gap", "disk", "failed", "stop", "check"}
)


class EventLog(QPlainTextEdit):
    """Read only; times are those at which the window heard of it."""

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self._theme = theme
        self.setReadOnly(True)
        self.setMaximumBlockCount(LINES_KEPT)
        self.setLineWrapMode(QPlainTextEdit.LineWrapMode.WidgetWidth)
        self.setMinimumHeight(64)

    def set_theme(self, theme: Theme) -> None:
        """Colour new lines for another theme; old ones keep their words."""
        self._theme = theme
        lines = self.toPlainText()
        self.setPlainText(lines)
        self.moveCursor(self.textCursor().MoveOperation.End)

    def add(self, kind: str, text: str) -> None:
        """Add a line; ``kind`` is a short word, bad ones are shown so."""
        time = QTime.currentTime().toString("HH:mm:ss")
        colour = self._theme.bad if kind in BAD_KINDS else self._theme.text
        self.appendHtml(
            f'<span style="color:{self._theme.muted}">{time}&nbsp;&nbsp;{escape(kind)}&nbsp;'
            f'</span> <span style="color:{colour}">{escape(text)}</span>'
        )
