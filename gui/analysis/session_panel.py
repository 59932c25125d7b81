"""Looking at a recorded session: its trials, and how well textures can be told apart."""

from __future__ import annotations

from PySide6.QtCore import (
    QAbstractTableModel,
    QItemSelection,
    QModelIndex,
    QPersistentModelIndex,
    Qt,
    Signal,
)
from PySide6.QtWidgets import (
    QAbstractItemView,
    QHBoxLayout,
    QHeaderView,
    QLineEdit,
    QPushButton,
    QTableView,
    QVBoxLayout,
    QWidget,
)

from gui.analysis.run_box import AnalysisRunBox
from gui.analysis.worker_tasks import SessionTable
from gui.widgets.labels import label, set_property

_Index = QModelIndex | QPersistentModelIndex
_ROOT = QModelIndex()


class TrialModel(QAbstractTableModel):
    """The rows of a session's trial table."""

    def __init__(self) -> None:
        super().__init__()
        self._table = SessionTable()

    def show(self, table: SessionTable) -> None:
        """Show another session."""
        self.beginResetModel()
        self._table = table
        self.endResetModel()

    def rowCount(self, parent: _Index = _ROOT) -> int:
        """Trials."""
        return len(self._table.rows)

    def columnCount(self, parent: _Index = _ROOT) -> int:
        """Figures a trial."""
        return len(self._table.columns)

    def data(self, index: _Index, role: int = Qt.ItemDataRole.DisplayRole) -> object:
        """A cell's text; figures stand at the right."""
        if role == Qt.ItemDataRole.DisplayRole:
            return self._table.rows[index.row()][index.column()]
        if role == Qt.ItemDataRole.TextAlignmentRole:
            return Qt.AlignmentFlag.AlignCenter
        return None

    def headerData(
        self,
        section: int,
        orientation: Qt.Orientation,
        role: int = Qt.ItemDataRole.DisplayRole,
    ) -> object:
        """Names of the columns, with units."""
        if role == Qt.ItemDataRole.DisplayRole and orientation is Qt.Orientation.Horizontal:
            return self._table.columns[section]
        return None


class SessionPanel(QWidget):
    """Emits what is asked for; answers come from the analysis process through the window."""

    browse_asked = Signal()
    open_asked = Signal(str)
    trial_asked = Signal(int)
    run_asked = Signal(str, str)
    cancel_asked = Signal()

    def __init__(self) -> None:
        super().__init__()
        self.folder = QLineEdit()
        self.folder.setPlaceholderText("A session's folder")
        self.browse, self.open = QPushButton("…"), QPushButton("Open")
        self.about = label("No session is open.", "muted", wraps=True)
        self.model = TrialModel()
        self.table = QTableView()
        self.box = AnalysisRunBox()
        self._path = ""
        self._set_up()
        self._lay_out()
        self.show_idle()

    def choose(self, folder: str) -> None:
        """Open a session's folder."""
        self.folder.setText(folder)
        self.open_asked.emit(folder)

    def show_session(self, table: SessionTable) -> None:
        """A session was read."""
        self._path = table.path
        self.model.show(table)
        header = self.table.horizontalHeader()
        header.setSectionResizeMode(QHeaderView.ResizeMode.Stretch)
        header.setSectionResizeMode(len(table.columns) - 1, QHeaderView.ResizeMode.Fixed)
        self.table.setColumnWidth(len(table.columns) - 1, 84)
        self.about.setText(table.about)
        set_property(self.about, "role", "muted")
        self.box.form.show_session(table.path)
        self.box.answer.clear()
        self.box.results.setEnabled(False)
        self.show_idle()
        if table.rows:
            self.table.selectRow(0)

    def show_failure(self, sentence: str) -> None:
        """What could not be read or classified, and why."""
        self.show_idle()
        self.about.setText(sentence)
        set_property(self.about, "role", "bad")

    def show_answer(self, sentence: str) -> None:
        """What came out."""
        self.show_idle()
        self.box.answer.setText(sentence)
        self.box.results.setEnabled(True)

    def show_busy(self) -> None:
        """An analysis is going."""
        set_property(self.about, "role", "muted")
        self.box.show_busy(True, self.model.rowCount() > 0)

    def show_idle(self) -> None:
        """Nothing is going."""
        self.box.show_busy(False, self.model.rowCount() > 0)

    def _set_up(self) -> None:
        self.browse.setFixedWidth(34)
        self.browse.setToolTip("Choose a session's folder")
        self.open.setFixedWidth(56)
        self.box.results.setEnabled(False)
        self.table.setModel(self.model)
        self.table.verticalHeader().hide()
        self.table.verticalHeader().setDefaultSectionSize(20)
        self.table.setSelectionBehavior(QAbstractItemView.SelectionBehavior.SelectRows)
        self.table.setSelectionMode(QAbstractItemView.SelectionMode.SingleSelection)
        self.table.setMinimumHeight(120)
        self.table.setAlternatingRowColors(True)
        self.table.setShowGrid(False)
        self.browse.clicked.connect(self.browse_asked)
        self.open.clicked.connect(lambda: self.open_asked.emit(self.folder.text()))
        self.folder.returnPressed.connect(lambda: self.open_asked.emit(self.folder.text()))
        self.table.selectionModel().selectionChanged.connect(self._selected)
        self.box.run_asked.connect(lambda way: self.run_asked.emit(way, self._path))
        self.box.cancel_asked.connect(self.cancel_asked)

    def _selected(self, selected: QItemSelection) -> None:
        rows = selected.indexes()
        if rows:
            self.trial_asked.emit(rows[0].row())

    def _lay_out(self) -> None:
        column = QVBoxLayout(self)
        column.setContentsMargins(6, 8, 6, 6)
        column.setSpacing(5)
        row = QHBoxLayout()
        row.addWidget(self.folder, 1)
        row.addWidget(self.browse)
        row.addWidget(self.open)
        column.addLayout(row)
        column.addWidget(self.about)
        column.addWidget(self.table, 1)
        column.addWidget(self.box)
