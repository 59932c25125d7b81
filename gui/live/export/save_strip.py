"""Save what the plots show: the folder, and a button for each kind of file."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtCore import QStandardPaths, Signal
from PySide6.QtWidgets import QLineEdit, QWidget

from gui.widgets.file_browser import PathKind, browse_button
from gui.widgets.labels import label
from gui.widgets.layouts import hbox, push_button


class SaveStrip(QWidget):
    """``folder``: where pictures and tables go."""

    picture_requested = Signal(str)
    """The folder."""
    table_requested = Signal(str)
    """The folder."""
    path_requested = Signal(object, object)
    """A :class:`PathKind`, and the function that takes the chosen path."""

    def __init__(self) -> None:
        super().__init__()
        pictures = QStandardPaths.StandardLocation.PicturesLocation
        default = QStandardPaths.writableLocation(pictures) or str(Path.home())
        self.folder = QLineEdit(default)
        self.folder.setMinimumWidth(80)
        self.folder.setAccessibleName("Folder of pictures and tables")
        self.picture = push_button(
            "Picture",
            lambda: self.picture_requested.emit(self.folder.text()),
            "Save the plots as they are now as a PNG",
        )
        self.table = push_button(
            "Table",
            lambda: self.table_requested.emit(self.folder.text()),
            "Save the samples in view as a CSV",
        )
        browse = browse_button(self.path_requested, PathKind.OUTPUT, self.folder.setText)
        row = (self.picture, self.table, label("in", "muted"), self.folder, browse)
        self.setLayout(hbox(*row, wide=3, margins=(6, 0, 6, 0)))
