"""Which rig the toolbar connects to, and which world a simulated one lives in."""

from __future__ import annotations

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QComboBox


class FileChoice(QComboBox):
    """A list of named choices that also takes files; its last line asks for one."""

    file_asked = Signal()

    def __init__(self, known: tuple[tuple[str, str], ...], ask: str, width: int) -> None:
        super().__init__()
        for text, spec in known:
            self.addItem(text, spec)
        self.addItem(ask, None)
        # A file's long name is cut short; it must not push STOP off the window.
        self.setSizeAdjustPolicy(self.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon)
        self.setMinimumWidth(width)
        self.activated.connect(self._chosen)

    def choose(self, spec: str) -> None:
        """Choose what is known by that name, or a file, which is offered from then on."""
        if (place := self.findData(spec)) < 0:
            place = self.count() - 1
            self.insertItem(place, spec.rsplit("/", 1)[-1], spec)
            self.setItemData(place, spec, Qt.ItemDataRole.ToolTipRole)
        self.setCurrentIndex(place)

    def _chosen(self, index: int) -> None:
        if self.itemData(index) is None:
            self.setCurrentIndex(0)
            self.file_asked.emit()
