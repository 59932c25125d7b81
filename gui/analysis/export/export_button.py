"""A button that saves what a page shows: a format is two clicks away."""

from __future__ import annotations

from PySide6.QtCore import QSize, Signal
from PySide6.QtWidgets import QMenu, QToolButton

from gui.analysis.export.picture_file import PICTURES
from gui.widgets.theme import scaled_px

TABLE = "csv"
FORMATS = (*PICTURES, TABLE)
_ARROW_PX = 14


class ExportButton(QToolButton):
    """A menu of file formats."""

    export_requested = Signal(str)
    """The suffix of the file: png, svg, pdf or csv."""

    def __init__(self, *formats: str) -> None:
        super().__init__()
        self.setText("Save")
        self.setToolTip("Save what this page shows as a file beside the session")
        self.setPopupMode(QToolButton.ToolButtonPopupMode.InstantPopup)
        self.formats = QMenu(self)
        self.suffixes = formats or FORMATS
        for suffix in self.suffixes:
            action = self.formats.addAction(suffix.upper())
            action.triggered.connect(lambda _=False, s=suffix: self.export_requested.emit(s))
        self.setMenu(self.formats)

    def sizeHint(self) -> QSize:
        """Return the size with room for the arrow beside the text."""
        return super().sizeHint() + QSize(scaled_px(_ARROW_PX), 0)
