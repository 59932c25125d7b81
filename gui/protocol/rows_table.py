"""Tables of texts: the planned order of trials, and the attempts as they come in."""

from __future__ import annotations

from collections.abc import Sequence

from PySide6.QtCore import QAbstractTableModel, QModelIndex, QPersistentModelIndex, Qt
from PySide6.QtGui import QColor, QResizeEvent
from PySide6.QtWidgets import QAbstractItemView, QHeaderView, QTableView

from gui.protocol.run_values import COMMITTED, TRIAL_COLUMNS, AttemptRow, Row
from gui.widgets.theme import applied_theme

_Index = QModelIndex | QPersistentModelIndex
_ROOT = QModelIndex()
_TEXT = Qt.ItemDataRole.DisplayRole
_VERDICT = TRIAL_COLUMNS.index("Verdict")


class OrderModel(QAbstractTableModel):
    """Rows of texts under named columns."""

    def __init__(self, columns: Row) -> None:
        super().__init__()
        self._columns = columns
        self._texts: Sequence[Row] = ()

    def set_texts(self, texts: Sequence[Row]) -> None:
        """Show other rows."""
        self.beginResetModel()
        self._texts = texts
        self.endResetModel()

    def rowCount(self, parent: _Index = _ROOT) -> int:
        """Return the number of rows."""
        return 0 if parent.isValid() else len(self._texts)

    def columnCount(self, parent: _Index = _ROOT) -> int:
        """Return the number of columns."""
        return 0 if parent.isValid() else len(self._columns)

    def data(self, index: _Index, role: int = _TEXT) -> object:
        """Return the text of a cell; a tooltip repeats it in full."""
        if role in (_TEXT, Qt.ItemDataRole.ToolTipRole):
            return self._texts[index.row()][index.column()]
        return None

    def headerData(self, section: int, orientation: Qt.Orientation, role: int = _TEXT) -> object:
        """Return the title of a column."""
        if orientation is Qt.Orientation.Horizontal and role == _TEXT:
            return self._columns[section]
        return None


class AttemptModel(OrderModel):
    """The attempts at a session's trials; rows are added while it grows."""

    def __init__(self) -> None:
        super().__init__(TRIAL_COLUMNS)
        self.rows: list[AttemptRow] = []

    def clear(self) -> None:
        """Show no attempts."""
        self.replace([])

    def replace(self, rows: Sequence[AttemptRow]) -> None:
        """Show other attempts."""
        self.rows = list(rows)
        self.set_texts([row.texts for row in self.rows])

    def append(self, rows: Sequence[AttemptRow]) -> None:
        """Add attempts behind the others."""
        if not rows:
            return
        last = len(self.rows) + len(rows) - 1
        self.beginInsertRows(_ROOT, len(self.rows), last)
        self.rows += rows
        self._texts = [*self._texts, *(row.texts for row in rows)]
        self.endInsertRows()

    def data(self, index: _Index, role: int = _TEXT) -> object:
        """Return a cell's text; a verdict is coloured too, beside its sign."""
        if role == Qt.ItemDataRole.ForegroundRole and index.column() == _VERDICT:
            theme, row = applied_theme(), self.rows[index.row()]
            return QColor(theme.ok if row.verdict == COMMITTED else theme.bad)
        return super().data(index, role)


class TitledHeader(QHeaderView):
    """A header whose columns are never narrower than the title of the stretched one."""

    def __init__(self, stretched: int) -> None:
        super().__init__(Qt.Orientation.Horizontal)
        self._stretched = stretched

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Follow a change of the texts' size, too."""
        self.setMinimumSectionSize(self.sectionSizeFromContents(self._stretched).width())
        super().resizeEvent(event)


def table_view(model: OrderModel, stretched: int) -> QTableView:
    """Return a view that selects whole rows; one column takes the spare width."""
    view = QTableView()
    view.setModel(model)
    view.setSelectionBehavior(QAbstractItemView.SelectionBehavior.SelectRows)
    view.setSelectionMode(QAbstractItemView.SelectionMode.SingleSelection)
    view.setWordWrap(False)
    view.verticalHeader().hide()
    view.verticalHeader().setDefaultSectionSize(22)
    header = TitledHeader(stretched)
    view.setHorizontalHeader(header)
    header.setSectionResizeMode(QHeaderView.ResizeMode.ResizeToContents)
    header.setResizeContentsPrecision(50)
    header.setSectionResizeMode(stretched, QHeaderView.ResizeMode.Stretch)
    view.setTabKeyNavigation(False)
    return view
