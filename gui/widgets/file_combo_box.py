"""Lists whose chosen text may be longer than the box, and one that also takes files."""

from __future__ import annotations

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QPaintEvent
from PySide6.QtWidgets import QComboBox, QStyle, QStyleOptionComboBox, QStylePainter

from gui.widgets.file_browser import PathKind
from gui.widgets.labels import plain_tooltip

_INSET_PX = 2


class ElidedComboBox(QComboBox):
    """A list whose chosen text ends in … where it is too long; its tooltip then has all of it."""

    def __init__(self) -> None:
        super().__init__()
        self._own_tooltip = ""
        self.currentTextChanged.connect(lambda _: self._tell_whole())

    def shown_text(self) -> str:
        """Return the chosen text, as far as there is room for it."""
        option = QStyleOptionComboBox()
        self.initStyleOption(option)
        part = QStyle.SubControl.SC_ComboBoxEditField
        place = self.style().subControlRect(QStyle.ComplexControl.CC_ComboBox, option, part, self)
        metrics, middle = self.fontMetrics(), Qt.TextElideMode.ElideMiddle
        return metrics.elidedText(self.currentText(), middle, place.width() - _INSET_PX)

    def set_own_tooltip(self, text: str) -> None:
        """Say what the list is for; the whole text stands above it."""
        self._own_tooltip = text
        self._tell_whole()

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw the box with the text that fits."""
        option, painter = QStyleOptionComboBox(), QStylePainter(self)
        self.initStyleOption(option)
        option.currentText = self.shown_text()
        painter.drawComplexControl(QStyle.ComplexControl.CC_ComboBox, option)
        painter.drawControl(QStyle.ControlElement.CE_ComboBoxLabel, option)

    def _tell_whole(self) -> None:
        lines = (self.currentText(), self._own_tooltip)
        self.setToolTip(plain_tooltip("\n".join(filter(None, lines))))


class FileComboBox(ElidedComboBox):
    """A list whose last item opens the file browser."""

    path_requested = Signal(object, object)

    def __init__(self, items: dict[str, str], kind: PathKind, browse: str, width_px: int) -> None:
        super().__init__()
        for text, data in items.items():
            self.addItem(text, data)
        self.addItem(browse, None)
        self._kind = kind
        # A long file name ends in …; it must not push STOP out of the window.
        self.setSizeAdjustPolicy(self.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon)
        self.setMinimumWidth(width_px)
        self.activated.connect(self._browse)

    def choose(self, data: str) -> None:
        """Choose the item with this data; add a file that is not in the list yet."""
        if (index := self.findData(data)) < 0:
            index = self.count() - 1
            self.insertItem(index, data.rsplit("/", 1)[-1], data)
            self.setItemData(index, data, Qt.ItemDataRole.ToolTipRole)
        self.setCurrentIndex(index)

    def _browse(self, index: int) -> None:
        if self.itemData(index) is None:
            self.setCurrentIndex(0)
            self.path_requested.emit(self._kind, self.choose)
