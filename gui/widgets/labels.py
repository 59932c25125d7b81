"""Labels, lamps and strips, and the style properties of widgets."""

from __future__ import annotations

from enum import StrEnum
from html import escape

from PySide6.QtCore import QEvent, QPointF, QRectF, Qt
from PySide6.QtGui import QColor, QPainter, QPaintEvent, QPen, QPolygonF, QResizeEvent, QShowEvent
from PySide6.QtWidgets import (
    QFrame,
    QLabel,
    QProgressBar,
    QPushButton,
    QSizePolicy,
    QWidget,
)

from gui.widgets.layouts import hbox
from gui.widgets.theme import applied_theme


class Level(StrEnum):
    """The verdict on a value."""

    OFF = "off"
    OK = "ok"
    WARN = "warn"
    BAD = "bad"


_CORNERS = {
    Level.WARN: ((0.5, 0.0), (1.0, 0.5), (0.5, 1.0), (0.0, 0.5)),
    Level.BAD: ((0.5, 0.0), (1.0, 1.0), (0.0, 1.0)),
}


class StatusLamp(QWidget):
    """A ring (off or unknown), a disc (OK), a diamond (WARN) or a triangle (BAD)."""

    def __init__(self, side_px: int) -> None:
        super().__init__()
        self.level = Level.OFF
        self.setFixedSize(side_px, side_px)

    def set_level(self, level: Level) -> None:
        """Show another level."""
        if level is not self.level:
            self.level = level
            self.update()

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw the level's shape in the colours of the applied theme."""
        theme = applied_theme()
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        box = QRectF(self.rect()).adjusted(1.5, 1.5, -1.5, -1.5)
        if self.level is Level.OFF:
            painter.setPen(QPen(QColor(theme.muted), 1.6))
            painter.drawEllipse(box)
            return
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(QColor(getattr(theme, self.level)))
        if self.level is Level.OK:
            painter.drawEllipse(box)
        else:
            width, height = box.width(), box.height()
            corners = [QPointF(x * width, y * height) for x, y in _CORNERS[self.level]]
            painter.drawPolygon(QPolygonF(corners).translated(box.topLeft()))


_LEAST_WIDTH_PX, _LEAST_HEIGHT_PX = 150, 46


class StopButton(QPushButton):
    """Stops as it goes down; it takes no focus, so that no key but Esc presses it."""

    def __init__(self) -> None:
        super().__init__("STOP")
        self.setObjectName("stop")
        self.setMinimumSize(_LEAST_WIDTH_PX, _LEAST_HEIGHT_PX)
        self.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self.setToolTip("Stop and lift the drum, and end every run (Esc)")


MOST_STEPS = 2**31 - 1
"""Of a progress bar."""


class WrappedLabel(QLabel):
    """A label of several lines, never lower than they are at its width.

    Layouts in layouts ask for the height at another width, such as that without a scroll bar. A
    hidden label reserves nothing: it may still have another width than where it will be shown, and
    a window that grows for it stays so high.
    """

    def __init__(self) -> None:
        super().__init__(wordWrap=True)

    def setText(self, text: str) -> None:
        """Show a text."""
        if text != self.text():
            super().setText(text)
            self._reserve_height()

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Reserve the height of the text at the new width."""
        super().resizeEvent(event)
        self._reserve_height()

    def changeEvent(self, event: QEvent) -> None:
        """Reserve the height of the text in other letters, which may be smaller."""
        super().changeEvent(event)
        if event.type() in (QEvent.Type.FontChange, QEvent.Type.StyleChange):
            self._reserve_height()

    def showEvent(self, event: QShowEvent) -> None:
        """Reserve the height of the text where it is shown."""
        super().showEvent(event)
        self._reserve_height()

    def _reserve_height(self) -> None:
        self.setMinimumHeight(0)  # Qt's height for a width is never below it: a text must shrink
        if self.text() and self.isVisible():
            self.setMinimumHeight(max(0, self.heightForWidth(self.width())))


class ElidedLabel(QLabel):
    """A line that ends in an ellipsis where it is too long.

    :meth:`text` and the tooltip that :func:`show_text` gives it have all of it.
    """

    def __init__(self, text: str = "", role: str = "") -> None:
        super().__init__(text)
        self.setTextFormat(Qt.TextFormat.PlainText)
        self.setProperty("role", role)
        self.setToolTip(plain_tooltip(text))
        elastic(self)

    @property
    def shown_text(self) -> str:
        """What the line shows of its text: the beginning of one that is too long."""
        line, metrics = " ".join(self.text().split()), self.fontMetrics()
        room_px = self.contentsRect().width()
        return metrics.elidedText(line, Qt.TextElideMode.ElideRight, room_px)

    def paintEvent(self, _: QPaintEvent) -> None:
        """Paint the text, shortened where it is longer than the line."""
        room, place = self.contentsRect(), int(self.alignment())
        colours, role = self.palette(), self.foregroundRole()
        painter = QPainter(self)
        text = self.shown_text
        self.style().drawItemText(painter, room, place, colours, self.isEnabled(), text, role)


def label(text: str = "", role: str = "", wraps: bool = False) -> QLabel:
    """Return a label; the theme styles its ``role`` (muted, heading, value, state, bad)."""
    widget = WrappedLabel() if wraps else QLabel()
    widget.setTextFormat(Qt.TextFormat.PlainText)
    widget.setText(text)
    widget.setProperty("role", role)
    return widget


def elastic(widget: QLabel) -> QLabel:
    """Let a label shrink below the width of its text; the tooltip then shows the rest."""
    widget.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)
    return widget


def show_text(widget: QLabel, text: str) -> None:
    """Set a label's text and tooltip, only if the text changed."""
    if widget.text() != text:
        widget.setText(text)
        widget.setToolTip(plain_tooltip(text))


def show_tooltip(widget: QWidget, text: str) -> None:
    """Set a tooltip, only if it changed: Qt tells every filter of each."""
    if widget.toolTip() != text:
        widget.setToolTip(text)


def plain_tooltip(text: str) -> str:
    """Return a tooltip that shows ``text`` as it is: Qt takes a tag in the first line for HTML."""
    return escape(text).replace("\n", "<br>") if "<" in text.partition("\n")[0] else text


def set_property(widget: QWidget, name: str, value: str) -> None:
    """Set a property that selectors of the style sheet use, and apply the style."""
    if widget.property(name) != value:
        widget.setProperty(name, value)
        widget.style().unpolish(widget)
        widget.style().polish(widget)


def show_progress(bar: QProgressBar, done: int, planned: int) -> None:
    """Show how much is done of what is planned, as far as a bar counts."""
    bar.setMaximum(min(max(planned, 1), MOST_STEPS))
    bar.setValue(min(max(done, 0), MOST_STEPS))


class Strip(QFrame):
    """A sentence and buttons, behind a lamp where it warns; hidden without a sentence."""

    def __init__(self) -> None:
        super().__init__()
        self.setProperty("role", "prompt")
        self.text = label("", "heading", wraps=True)
        self.hide()

    def lay_out(self, *buttons: QWidget, warns: bool = True) -> None:
        """Put the sentence and the buttons, or what belongs to the sentence, in a row."""
        lamp = StatusLamp(18)
        lamp.set_level(Level.WARN)
        row = (lamp, self.text, *buttons) if warns else (self.text, *buttons)
        self.setLayout(hbox(*row, wide=int(warns), spacing=6, margins=(10, 6, 10, 6)))
