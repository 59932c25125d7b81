"""The Analysis tab's panel: a session's trials, and the classification of its textures."""

from __future__ import annotations

from PySide6.QtCore import (
    QAbstractTableModel,
    QItemSelection,
    QModelIndex,
    QPersistentModelIndex,
    Qt,
    Signal,
)
from PySide6.QtWidgets import QHeaderView, QLineEdit, QTableView, QWidget

from gui.analysis.run_box import AnalysisRunBox
from gui.analysis.task_values import SessionTable
from gui.widgets.file_browser import PathKind, browse_button
from gui.widgets.labels import label, set_property
from gui.widgets.layouts import hbox, push_button, vbox

_Index = QModelIndex | QPersistentModelIndex
_ROOT, _TEXT = QModelIndex(), Qt.ItemDataRole.DisplayRole


class TrialModel(QAbstractTableModel):
    """A Qt model of a session's trial table."""

    def __init__(self) -> None:
        super().__init__()
        self._table = SessionTable()

    def set_table(self, table: SessionTable) -> None:
        """Show the trials of another session."""
        self.beginResetModel()
        self._table = table
        self.endResetModel()

    def rowCount(self, parent: _Index = _ROOT) -> int:
        """Return the number of trials."""
        return len(self._table.rows)

    def columnCount(self, parent: _Index = _ROOT) -> int:
        """Return the number of columns."""
        return len(self._table.columns)

    def data(self, index: _Index, role: int = _TEXT) -> object:
        """Return the text of a cell, or its alignment."""
        if role == _TEXT:
            return self._table.rows[index.row()][index.column()]
        if role == Qt.ItemDataRole.TextAlignmentRole:
            return Qt.AlignmentFlag.AlignCenter
        return None

    def headerData(self, section: int, orientation: Qt.Orientation, role: int = _TEXT) -> object:
        """Return the name of a column."""
        if role == _TEXT and orientation is Qt.Orientation.Horizontal:
            return self._table.columns[section]
        return None


class SessionPanel(QWidget):
    """Controls for a session; emits requests for the worker process, and shows its results."""

    open_requested = Signal(str)
    trial_requested = Signal(int)
    run_requested = Signal(str, str)
    """The key of the method, and the session folder."""
    path_requested = Signal(object, object)

    def __init__(self) -> None:
        super().__init__()
        self.folder = QLineEdit(placeholderText="Session folder")
        requested = self.path_requested
        self.folder_button = browse_button(requested, PathKind.SESSION, self.open_session)
        self.open_button = push_button("Open", self._open)
        self.about = label("No session is open.", "muted", wraps=True)
        self.digest = QLineEdit(readOnly=True, placeholderText="No closing digest")
        self.model = TrialModel()
        self.table = QTableView(showGrid=False)
        self.run_box = AnalysisRunBox()
        self._path = ""
        self._set_up()
        self._lay_out()
        self.show_idle()

    def open_session(self, folder: str) -> None:
        """Request the trials of a session folder."""
        self.folder.setText(folder)
        self.open_requested.emit(folder)

    def show_session(self, table: SessionTable) -> None:
        """Show a session and its first trial."""
        self._path = table.path
        self.model.set_table(table)
        header = self.table.horizontalHeader()
        header.setSectionResizeMode(QHeaderView.ResizeMode.Stretch)
        header.setSectionResizeMode(len(table.columns) - 1, QHeaderView.ResizeMode.Fixed)
        self.table.setColumnWidth(len(table.columns) - 1, 84)
        self.about.setText(table.about)
        self.digest.setText(table.closing_digest)
        self.digest.setCursorPosition(0)
        set_property(self.about, "role", "muted")
        self.run_box.show_experiment(table.experiment)
        self.run_box.form.show_session(table.path)
        self.run_box.result.clear()
        self.run_box.results_button.setEnabled(False)
        self.show_idle()
        if table.rows:
            self.table.selectRow(0)

    def show_failure(self, sentence: str) -> None:
        """Show why the worker could not read or classify a session."""
        self.show_idle()
        self.about.setText(sentence)
        set_property(self.about, "role", "bad")

    def show_result(self, sentence: str) -> None:
        """Show the result of an analysis."""
        self.show_idle()
        self.run_box.result.setText(sentence)
        self.run_box.results_button.setEnabled(True)

    def show_busy(self) -> None:
        """Show that an analysis runs."""
        set_property(self.about, "role", "muted")
        self.run_box.show_busy(True, self.model.rowCount() > 0)

    def show_idle(self) -> None:
        """Show that no analysis runs."""
        self.run_box.show_busy(False, self.model.rowCount() > 0)

    def _set_up(self) -> None:
        self.open_button.setFixedWidth(56)
        self.digest.setToolTip("The closing digest: rigctl verify --digest compares it")
        self.run_box.results_button.setEnabled(False)
        self.table.setModel(self.model)
        self.table.verticalHeader().hide()
        self.table.verticalHeader().setDefaultSectionSize(20)
        self.table.setSelectionBehavior(QTableView.SelectionBehavior.SelectRows)
        self.table.setSelectionMode(QTableView.SelectionMode.SingleSelection)
        self.table.setMinimumHeight(120)
        self.table.setAlternatingRowColors(True)
        self.folder.returnPressed.connect(self._open)
        self.table.selectionModel().selectionChanged.connect(self._request_trial)
        self.run_box.run_requested.connect(lambda key: self.run_requested.emit(key, self._path))
        self.run_box.path_requested.connect(self.path_requested)

    def _open(self) -> None:
        self.open_requested.emit(self.folder.text())

    def _request_trial(self, selected: QItemSelection) -> None:
        if indexes := selected.indexes():
            self.trial_requested.emit(indexes[0].row())

    def _lay_out(self) -> None:
        folder = hbox(self.folder, self.folder_button, self.open_button)
        digest = hbox(label("Digest"), self.digest)
        digest.setStretch(1, 1)
        rows = (folder, self.about, digest, self.table, self.run_box)
        column = vbox(*rows, spacing=5, margins=(6, 8, 6, 6))
        column.setStretch(3, 1)
        self.setLayout(column)
