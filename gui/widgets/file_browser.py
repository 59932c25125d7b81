"""Choosing a file or folder inside the window, where no dialog can cover STOP."""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum
from pathlib import Path

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QFileDialog, QVBoxLayout, QWidget


class Pick(Enum):
    """What is looked for: window title of the page and Qt's file mode."""

    RIG_FILE = ("Rig description (rig.toml)", QFileDialog.FileMode.ExistingFile)
    WORLD_FILE = ("World of a simulated rig (*.toml)", QFileDialog.FileMode.ExistingFile)
    PROTOCOL = ("Protocol (*.toml)", QFileDialog.FileMode.ExistingFile)
    OUTPUT = ("Folder that will hold the new session", QFileDialog.FileMode.Directory)
    SESSION = ("Folder of a session", QFileDialog.FileMode.Directory)
    MODEL = ("Model file (*.h5)", QFileDialog.FileMode.ExistingFile)
    INTERRUPTED = ("Folder of the session to go on with", QFileDialog.FileMode.Directory)


class FileBrowser(QWidget):
    """A page with Qt's own file chooser as a plain widget."""

    closed = Signal()

    def __init__(self) -> None:
        super().__init__()
        self._column = QVBoxLayout(self)
        self._column.setContentsMargins(0, 0, 0, 0)
        self.dialog: QFileDialog | None = None

    def ask(self, pick: Pick, start: Path, done: Callable[[str], None]) -> None:
        """Show the chooser; ``done`` gets the path unless it is cancelled."""
        self.dismiss()
        title, mode = pick.value
        dialog = QFileDialog(self, title, str(start))
        dialog.setWindowFlags(Qt.WindowType.Widget)
        dialog.setOption(QFileDialog.Option.DontUseNativeDialog)
        dialog.setOption(QFileDialog.Option.ShowDirsOnly, mode is QFileDialog.FileMode.Directory)
        dialog.setSizeGripEnabled(False)
        dialog.setFileMode(mode)
        if mode is QFileDialog.FileMode.ExistingFile:
            ours = "Models (*.h5)" if pick is Pick.MODEL else "TOML files (*.toml)"
            dialog.setNameFilters([ours, "All files (*)"])
        dialog.fileSelected.connect(done)
        dialog.finished.connect(lambda _: self.dismiss())
        self.dialog = dialog
        self._column.addWidget(dialog)
        dialog.show()

    def dismiss(self) -> None:
        """Close the chooser."""
        if self.dialog is None:
            return
        dialog, self.dialog = self.dialog, None
        self._column.removeWidget(dialog)
        dialog.deleteLater()
        self.closed.emit()
