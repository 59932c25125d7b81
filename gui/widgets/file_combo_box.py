"""A list of named items that also takes files."""

from __future__ import annotations

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QComboBox

from gui.widgets.file_browser import PathKind


class FileComboBox(QComboBox):
    """A list whose last item opens the file browser."""

    path_requested = Signal(object, object)

    def __init__(self, items: dict[str, str], kind: PathKind, browse: str, width_px: int) -> None:
        super().__init__()
        for text, data in items.items():
            self.addItem(text, data)
        self.addItem(browse, None)
        self._kind = kind
        # A long file name is cut off; it must not push STOP out of the window.
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
