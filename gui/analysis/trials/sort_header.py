"""The names of a table's columns: a click sorts by one, and so do the keys."""

from __future__ import annotations

from PySide6.QtCore import QRect, Qt, Signal
from PySide6.QtGui import QFocusEvent, QKeyEvent, QPainter, QPen
from PySide6.QtWidgets import QHeaderView

_Key = Qt.Key
_STEPS = {_Key.Key_Left: -1, _Key.Key_Right: 1}
_SORTS = (_Key.Key_Return, _Key.Key_Enter, _Key.Key_Space)
FRAME_PX = 2


class SortHeader(QHeaderView):
    """Takes the focus: left and right choose a column, Return sorts by it, down leaves."""

    left = Signal()
    """The user goes on to the rows."""
    scroll_requested = Signal(int)
    """The pixels that bring the chosen column into view."""

    def __init__(self) -> None:
        super().__init__(Qt.Orientation.Horizontal)
        self.column = 0
        """The column that the keys have chosen."""
        self.setSectionsClickable(True)
        self.setSortIndicatorClearable(True)
        self.sectionCountChanged.connect(lambda _, count: self._take_focus(count > 0))
        self.setAccessibleName("Columns")
        self.sortIndicatorChanged.connect(lambda *_: self._describe())

    def sort(self, column: int) -> None:
        """Sort by a column as a click does: rising, then falling, then as recorded."""
        rising, falling = Qt.SortOrder.AscendingOrder, Qt.SortOrder.DescendingOrder
        if self.sortIndicatorSection() != column:
            self.setSortIndicator(column, rising)
        elif self.sortIndicatorOrder() is rising:
            self.setSortIndicator(column, falling)
        else:
            self.setSortIndicator(-1, rising)

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Choose a column, sort by it, or go on to the rows."""
        key, last = event.key(), self.count() - 1
        if key in _STEPS:
            self._choose(self.column + _STEPS[_Key(key)])
        elif key in (_Key.Key_Home, _Key.Key_End):
            self._choose(0 if key == _Key.Key_Home else last)
        elif key in _SORTS and 0 <= self.column <= last:
            self.sort(self.column)
        elif key == _Key.Key_Down:
            self.left.emit()
        else:
            super().keyPressEvent(event)

    def focusInEvent(self, event: QFocusEvent) -> None:
        """Frame the chosen column, which is in view."""
        super().focusInEvent(event)
        self._choose(self.column)

    def focusOutEvent(self, event: QFocusEvent) -> None:
        """Remove the frame."""
        super().focusOutEvent(event)
        self.viewport().update()

    def paintSection(self, painter: QPainter, rect: QRect, section: int) -> None:
        """Paint a name, in a frame if the keys have chosen it."""
        super().paintSection(painter, rect, section)
        if self.hasFocus() and section == self.column:
            painter.setPen(QPen(self.palette().highlight().color(), FRAME_PX))
            painter.setBrush(Qt.BrushStyle.NoBrush)
            painter.drawRect(rect.adjusted(1, 1, -FRAME_PX, -FRAME_PX))

    def _take_focus(self, has_columns: bool) -> None:
        policy = Qt.FocusPolicy.TabFocus if has_columns else Qt.FocusPolicy.NoFocus
        self.setFocusPolicy(policy)

    def _choose(self, column: int) -> None:
        self.column = min(max(column, 0), max(self.count() - 1, 0))
        place = self.sectionViewportPosition(self.column)
        beyond = place + self.sectionSize(self.column) - self.viewport().width()
        if place < 0 or beyond > 0:
            self.scroll_requested.emit(place if place < 0 else min(beyond, place))
        self._describe()
        self.viewport().update()

    def _describe(self) -> None:
        """Tell a screen reader the chosen column and the order."""
        name = self._name(self.column)
        by = self.sortIndicatorSection()
        is_rising = self.sortIndicatorOrder() is Qt.SortOrder.AscendingOrder
        order = f"{self._name(by)} {'rising' if is_rising else 'falling'}"
        self.setAccessibleDescription(f"{name}; sorted by {order if by >= 0 else 'recording'}")

    def _name(self, column: int) -> str:
        if not 0 <= column < self.count():
            return ""
        return str(self.model().headerData(column, self.orientation()))
