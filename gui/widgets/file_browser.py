"""A file dialog inside the window, where no dialog can cover STOP, and lists that take files."""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum
from functools import partial
from pathlib import Path

from PySide6.QtCore import Qt, Signal, SignalInstance
from PySide6.QtGui import QPaintEvent, QShowEvent
from PySide6.QtWidgets import (
    QApplication,
    QComboBox,
    QFileDialog,
    QHeaderView,
    QLineEdit,
    QListView,
    QPushButton,
    QStyle,
    QStyleOptionComboBox,
    QStylePainter,
    QTreeView,
    QWidget,
)
from shiboken6 import isValid

from gui.widgets.labels import label, plain_tooltip, show_tooltip
from gui.widgets.layouts import ComboBox, push_button, vbox
from gui.widgets.theme import scaled_px

PLACES_PX = 120
_TOML, _MODEL = "TOML files (*.toml)", "Models (*.h5)"


class PathKind(Enum):
    """What the user chooses: title, name filter (a folder has none), and tooltip of the button.

    A panel's ``path_requested`` carries a kind and the function that takes the chosen path.
    """

    RIG_FILE = ("Rig description (rig.toml)", _TOML, "")
    FINGER_FILE = ("Rig of the moving finger (finger.toml)", _TOML, "")
    WORLD_FILE = ("World of a simulated rig (*.toml)", _TOML, "")
    PROTOCOL = ("Protocol (*.toml)", _TOML, "Open a protocol file")
    OUTPUT = ("Folder for new sessions", "", "Choose a folder")
    DATA = ("Folder that holds sessions", "", "Choose a folder")
    RESULTS = ("Folder for results", "", "Choose a folder")
    RECORDINGS = ("Folder of recordings", "", "Choose a folder; the field takes a file, too")
    MAP = ("Map of the columns (*.toml)", _TOML, "Choose a map")
    PLOTS = ("Python file of own plots (*.py)", "Python files (*.py)", "Choose a Python file")
    TABLE = ("Folder of the new table", "", "Choose a folder; then type the name of the file")
    SESSION = ("Session folder", "", "Choose a session folder")
    ANALYSIS_FILE = ("Analysis file (*.toml)", _TOML, "Choose an analysis file")
    MODEL = ("Model file (*.h5)", _MODEL, "Choose a model file")
    FINGER_MODEL = (
        "Session folder of the training or calibration",
        "",
        "Choose the session that holds the model",
    )
    INTERRUPTED = (
        "Folder of the session to continue",
        "",
        "Run the remaining trials of an interrupted session",
    )


def browse_button(
    requested: SignalInstance, kind: PathKind, selected: Callable[[str], None], text: str = "…"
) -> QPushButton:
    """Return a button that emits ``requested`` with a kind and the function for the path."""
    return push_button(text, lambda: requested.emit(kind, selected), kind.value[2])


class FileBrowser(QWidget):
    """A page that holds Qt's own file dialog as a plain widget."""

    closed = Signal()

    def __init__(self) -> None:
        super().__init__()
        self.title = label("", "heading")
        self.title.setIndent(9)
        self._column = vbox(self.title, spacing=6)
        self.setLayout(self._column)
        self.dialog: QFileDialog | None = None
        self._folders: dict[PathKind, str] = {}
        self._asker: QWidget | None = None

    def open(self, kind: PathKind, selected: Callable[[str], None], first: str = "") -> None:
        """Show the dialog; ``selected`` gets the path unless the user cancels.

        It begins where the last path of the kind was chosen, at the first time in ``first``.
        """
        self.dismiss()
        self._asker = QApplication.focusWidget()
        title, name_filter, _ = kind.value
        self.title.setText(title)
        folder = self._folders.get(kind) or first
        is_there = bool(folder) and Path(folder).is_dir()
        dialog = QFileDialog(self, title, folder if is_there else str(Path.home()))
        dialog.setWindowFlags(Qt.WindowType.Widget)
        dialog.setOption(QFileDialog.Option.DontUseNativeDialog)
        dialog.setSizeGripEnabled(False)
        for places in dialog.findChildren(QListView, "sidebar"):
            places.setMinimumWidth(scaled_px(PLACES_PX))  # Qt cuts the names of the places
        if name_filter:
            dialog.setFileMode(QFileDialog.FileMode.ExistingFile)
            dialog.setNameFilters([name_filter, "All files (*)"])
        else:
            dialog.setFileMode(QFileDialog.FileMode.Directory)
            dialog.setOption(QFileDialog.Option.ShowDirsOnly)
        dialog.fileSelected.connect(lambda path: self._remember(kind, path))
        dialog.fileSelected.connect(selected)
        dialog.finished.connect(lambda _: self.dismiss())
        for place in dialog.findChildren(QComboBox, "lookInCombo"):
            place.setToolTip(place.currentText())  # Qt shortens a long one
            place.currentTextChanged.connect(partial(_show_tooltip, place))
        for tree in dialog.findChildren(QTreeView):
            tree.header().setSectionResizeMode(QHeaderView.ResizeMode.ResizeToContents)
        self.dialog = dialog
        self._column.addWidget(dialog, 1)
        dialog.show()
        self._focus_name()

    def showEvent(self, event: QShowEvent) -> None:
        """Let the user type a path at once."""
        super().showEvent(event)
        self._focus_name()

    def dismiss(self) -> None:
        """Close the dialog."""
        if self.dialog is None:
            return
        dialog, self.dialog = self.dialog, None
        dialog.hide()
        self._column.removeWidget(dialog)
        dialog.deleteLater()
        self.closed.emit()
        asker, self._asker = self._asker, None
        if asker is not None and isValid(asker) and asker.isVisible():
            asker.setFocus(Qt.FocusReason.ShortcutFocusReason)

    def _remember(self, kind: PathKind, path: str) -> None:
        self._folders[kind] = str(Path(path).parent)

    def _focus_name(self) -> None:
        if self.dialog is not None and self.isVisible():
            for name in self.dialog.findChildren(QLineEdit, "fileNameEdit"):
                name.setFocus(Qt.FocusReason.ShortcutFocusReason)


def _show_tooltip(place: QComboBox, text: str) -> None:
    """Set a tooltip; PySide cannot connect to a method of a widget that Qt has made."""
    place.setToolTip(text)


_INSET_PX, _ICON_GAP_PX = 2, 4


class ElidedComboBox(ComboBox):
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
        icon_px = 0 if option.currentIcon.isNull() else option.iconSize.width() + _ICON_GAP_PX
        return metrics.elidedText(self.currentText(), middle, place.width() - _INSET_PX - icon_px)

    def set_own_tooltip(self, text: str) -> None:
        """Say what the list is for; the whole text stands above it."""
        self._own_tooltip = text
        self._tell_whole()

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw the box with the text that fits."""
        option, painter = QStyleOptionComboBox(), QStylePainter(self)
        self.initStyleOption(option)
        option.currentText = self.shown_text() or self.placeholderText()
        painter.drawComplexControl(QStyle.ComplexControl.CC_ComboBox, option)
        painter.drawControl(QStyle.ControlElement.CE_ComboBoxLabel, option)

    def _tell_whole(self) -> None:
        lines = (self.currentText(), self._own_tooltip)
        show_tooltip(self, plain_tooltip("\n".join(filter(None, lines))))


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
