"""A Qt model of a table of trials, which sorts and filters itself."""

from __future__ import annotations

import numpy as np
from PySide6.QtCore import QAbstractTableModel, QModelIndex, QPersistentModelIndex, Qt

from gui.analysis.trials.trial_table import AttemptTable, Rows
from gui.widgets.labels import plain_tooltip

_Index = QModelIndex | QPersistentModelIndex
_ROOT, _TEXT = QModelIndex(), Qt.ItemDataRole.DisplayRole


class TrialModel(QAbstractTableModel):
    """Rows of a :class:`AttemptTable` that a filter lets through, in a chosen order."""

    def __init__(self) -> None:
        super().__init__()
        self.table = AttemptTable()
        self._words = ""
        self._sorted_by: tuple[int, bool] | None = None
        self._rows: Rows = self.table.row

    def set_table(self, table: AttemptTable) -> None:
        """Show other trials; filter and order stay, the order only if the columns do."""
        names = [column.name for column in table.columns]
        if names != [column.name for column in self.table.columns]:
            self._sorted_by = None
        self.table = table
        self._update()

    def set_filter(self, words: str) -> None:
        """Show the trials that contain each word in any column."""
        self._words = words
        self._update()

    def sort(self, column: int, order: Qt.SortOrder = Qt.SortOrder.AscendingOrder) -> None:
        """Sort by a column; -1 is the order of recording."""
        descending = order is Qt.SortOrder.DescendingOrder
        self._sorted_by = (column, descending) if column >= 0 else None
        self._update()

    def table_row(self, row: int) -> int:
        """Return the row of the table that is shown in a row of the view."""
        return int(self._rows[row])

    def shown_row(self, session: int, row: int) -> int:
        """Return where a session's row is shown, -1 where it is not."""
        table = self.table
        at = np.flatnonzero((table.session[self._rows] == session) & (table.row[self._rows] == row))
        return int(at[0]) if len(at) else -1

    @property
    def shown_rows(self) -> Rows:
        """All rows of the table that are shown, in their order, int64 (n,)."""
        return self._rows

    def rowCount(self, parent: _Index = _ROOT) -> int:
        """Return the number of trials that are shown."""
        return 0 if parent.isValid() else len(self._rows)

    def columnCount(self, parent: _Index = _ROOT) -> int:
        """Return the number of columns."""
        return 0 if parent.isValid() else len(self.table.columns)

    def data(self, index: _Index, role: int = _TEXT) -> object:
        """Return the text of a cell, which is its tooltip too, or its alignment."""
        if role == _TEXT:
            return self._text(index)
        if role == Qt.ItemDataRole.ToolTipRole:
            return plain_tooltip(self._text(index))
        if role == Qt.ItemDataRole.TextAlignmentRole:
            return Qt.AlignmentFlag.AlignCenter
        return None

    def headerData(self, section: int, orientation: Qt.Orientation, role: int = _TEXT) -> object:
        """Return the name of a column, or what it means."""
        if orientation is not Qt.Orientation.Horizontal:
            return None
        if role == _TEXT:
            return self.table.columns[section].name
        if role == Qt.ItemDataRole.ToolTipRole:
            return self.table.columns[section].meaning
        return None

    def _text(self, index: _Index) -> str:
        return self.table.columns[index.column()].text(int(self._rows[index.row()]))

    def _update(self) -> None:
        self.beginResetModel()
        table = self.table
        rows = np.arange(len(table), dtype=np.int64)
        if self._sorted_by is not None and table.columns:
            column, descending = self._sorted_by
            rows = table.sorted_rows(column, descending=descending)
        self._rows = rows[table.matching(self._words)[rows]] if table.columns else rows
        self.endResetModel()
