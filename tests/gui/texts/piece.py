"""A text of a widget with the room that it needs and the room that it has."""

from __future__ import annotations

from typing import NamedTuple

from PySide6.QtCore import QRect, QSize, Qt
from PySide6.QtWidgets import QStyle, QWidget

SLACK_PX = 1


class Piece(NamedTuple):
    """A text, the size that it needs, and its place in the widget's own pixels.

    ``is_elided`` says that the widget itself shows less than the text.
    """

    text: str
    needs: QSize
    place: QRect
    is_elided: bool = False

    @property
    def fits(self) -> bool:
        """Whether the place is large enough."""
        too_wide = self.needs.width() > self.place.width() + SLACK_PX
        too_high = self.needs.height() > self.place.height() + SLACK_PX
        return not (self.is_elided or too_wide or too_high)

    def shown_in(self, widget: QWidget, alignment: Qt.AlignmentFlag) -> QRect:
        """Return the pixels of the widget that the text covers."""
        size = self.needs.boundedTo(self.place.size())
        return QStyle.alignedRect(widget.layoutDirection(), alignment, size, self.place)


class CutText(NamedTuple):
    """A text that is not shown whole: the widget, the text and the reason."""

    where: str
    text: str
    reason: str

    def __str__(self) -> str:
        return f"{self.where}: {self.text!r} {self.reason}"


def lacks(needs: QSize, has: QSize) -> str:
    """Return the sentence for a text without enough room."""
    return f"needs {needs.width()} × {needs.height()} px and has {has.width()} × {has.height()} px"


def path_of(widget: QWidget) -> str:
    """Return the classes of a widget and of its parents up to the window, innermost last."""
    names: list[str] = []
    parent: QWidget | None = widget
    while parent is not None and not parent.isWindow():
        name = type(parent).__name__
        if name not in ("QWidget", "QSplitter", "QStackedWidget", "QScrollArea"):
            names.append(name)
        parent = parent.parentWidget()
    return "/".join(reversed(names))
