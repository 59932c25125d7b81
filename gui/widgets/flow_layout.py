"""A row of controls that goes on in the next line where it is too long for the window."""

from __future__ import annotations

from PySide6.QtCore import QPoint, QRect, QSize, Qt
from PySide6.QtWidgets import QLayout, QLayoutItem, QWidget

_Line = list[tuple[QLayoutItem, int]]
"""The items of a line with their widths in pixels."""


class FlowLayout(QLayout):
    """Puts widgets beside each other, as many in a line as fit.

    Widgets that expand, such as fields and scroll bars, share the spare width of their line.
    ``margins``: left, top, right and bottom.
    """

    def __init__(self, *widgets: QWidget, margins: tuple[int, int, int, int] = (0, 0, 0, 0)):
        super().__init__()
        self._items: list[QLayoutItem] = []
        self.setContentsMargins(*margins)
        self.setSpacing(4)
        for widget in widgets:
            self.addWidget(widget)

    def addItem(self, item: QLayoutItem) -> None:
        """Take an item, as Qt asks for it."""
        self._items.append(item)

    def count(self) -> int:
        """Return the number of items."""
        return len(self._items)

    def itemAt(self, index: int) -> QLayoutItem | None:
        """Return an item, None beyond the last."""
        return self._items[index] if 0 <= index < len(self._items) else None

    def takeAt(self, index: int) -> QLayoutItem | None:
        """Give an item away, None beyond the last."""
        return self._items.pop(index) if 0 <= index < len(self._items) else None

    def hasHeightForWidth(self) -> bool:
        """Say that a narrower row is higher."""
        return True

    def heightForWidth(self, width: int) -> int:
        """Return the height of all lines."""
        return self._place(QRect(0, 0, width, 0), is_shown=False)

    def sizeHint(self) -> QSize:
        """Return the size with everything in one line."""
        widths = [_width(item) for item in self._items if not item.isEmpty()]
        width_px = sum(widths) + self.spacing() * max(0, len(widths) - 1)
        return self._with_margins(width_px)

    def minimumSize(self) -> QSize:
        """Return the size that the widest item needs."""
        return self._with_margins(max(map(_width, self._items), default=0))

    def setGeometry(self, rect: QRect) -> None:
        """Place the items."""
        super().setGeometry(rect)
        self._place(rect, is_shown=True)

    def _with_margins(self, width_px: int) -> QSize:
        margins = self.contentsMargins()
        height_px = max((item.sizeHint().height() for item in self._items), default=0)
        vertical_px = margins.top() + margins.bottom()
        return QSize(width_px + margins.left() + margins.right(), height_px + vertical_px)

    def _place(self, rect: QRect, *, is_shown: bool) -> int:
        """Return the height of all lines; place the items if they are shown."""
        inside = rect.marginsRemoved(self.contentsMargins())
        top = inside.top()
        for line in self._lines(inside.width()):
            height_px = max(item.sizeHint().height() for item, _ in line)
            left = inside.left()
            for item, width_px in line if is_shown else ():
                item.setGeometry(QRect(QPoint(left, top), QSize(width_px, height_px)))
                left += width_px + self.spacing()
            top += height_px + self.spacing()
        return (
            max(top - self.spacing(), inside.top()) - rect.top() + self.contentsMargins().bottom()
        )

    def _lines(self, width_px: int) -> list[_Line]:
        lines: list[list[QLayoutItem]] = []
        used_px = 0
        for item in self._items:
            if item.isEmpty():
                continue
            if not lines or used_px + self.spacing() + _width(item) > width_px:
                lines.append([])
                used_px = -self.spacing()
            lines[-1].append(item)
            used_px += self.spacing() + _width(item)
        return [self._stretched(line, width_px) for line in lines]

    def _stretched(self, line: list[QLayoutItem], width_px: int) -> _Line:
        """Return the widths of a line's items: those that expand share what is left."""
        widths = [_width(item) for item in line]
        spare_px = width_px - sum(widths) - self.spacing() * (len(line) - 1)
        growing = [i for i, item in enumerate(line) if _grows(item)]
        for i in growing:
            widths[i] += max(0, spare_px) // len(growing)
        return list(zip(line, widths, strict=True))


def _width(item: QLayoutItem) -> int:
    return max(item.sizeHint().width(), item.minimumSize().width())


def _grows(item: QLayoutItem) -> bool:
    return bool(item.expandingDirections() & Qt.Orientation.Horizontal)
