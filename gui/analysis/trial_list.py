"""The list of trials: a filter, a table that sorts and filters itself, and why a trial is out."""

from __future__ import annotations

import numpy as np
from PySide6.QtCore import (
    QAbstractTableModel,
    QEvent,
    QModelIndex,
    QPersistentModelIndex,
    QRect,
    Qt,
    Signal,
)
from PySide6.QtGui import QFocusEvent, QKeyEvent, QPainter, QPen
from PySide6.QtWidgets import QHeaderView, QLineEdit, QTableView, QWidget

from gui.analysis.trial_table import AttemptTable, Rows
from gui.widgets.formatting import grouped
from gui.widgets.labels import label, plain_tooltip
from gui.widgets.layouts import hbox, push_button, vbox

_Index = QModelIndex | QPersistentModelIndex
_ROOT, _TEXT = QModelIndex(), Qt.ItemDataRole.DisplayRole
_TOOLTIP, _ALIGNMENT = Qt.ItemDataRole.ToolTipRole, Qt.ItemDataRole.TextAlignmentRole
_CENTRE = Qt.AlignmentFlag.AlignCenter
"""Names of their own: a table that is drawn asks for thousands of values."""


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
        if role == _ALIGNMENT:
            return _CENTRE
        if role == _TOOLTIP:
            return plain_tooltip(self._text(index))
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


_Key = Qt.Key
_STEPS = {_Key.Key_Left: -1, _Key.Key_Right: 1}
_SORTS = (_Key.Key_Return, _Key.Key_Enter, _Key.Key_Space)
FRAME_PX = 2


class SortHeader(QHeaderView):
    """Takes the focus: left and right choose a column, Return sorts by it, down leaves."""

    left = Signal()
    """The user goes on to the rows."""
    scroll_requested = Signal(int)
    """The pixels that bring the chosen column into view."""

    def __init__(self) -> None:
        super().__init__(Qt.Orientation.Horizontal)
        self.column = 0
        """The column that the keys have chosen."""
        self.setSectionsClickable(True)
        self.setSortIndicatorClearable(True)
        self.sectionCountChanged.connect(lambda _, count: self._take_focus(count > 0))
        self.setAccessibleName("Columns")
        self.sortIndicatorChanged.connect(lambda *_: self._describe())

    def sort(self, column: int) -> None:
        """Sort by a column as a click does: rising, then falling, then as recorded."""
        rising, falling = Qt.SortOrder.AscendingOrder, Qt.SortOrder.DescendingOrder
        if self.sortIndicatorSection() != column:
            self.setSortIndicator(column, rising)
        elif self.sortIndicatorOrder() is rising:
            self.setSortIndicator(column, falling)
        else:
            self.setSortIndicator(-1, rising)

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Choose a column, sort by it, or go on to the rows."""
        key, last = event.key(), self.count() - 1
        if key in _STEPS:
            self._choose(self.column + _STEPS[_Key(key)])
        elif key in (_Key.Key_Home, _Key.Key_End):
            self._choose(0 if key == _Key.Key_Home else last)
        elif key in _SORTS and 0 <= self.column <= last:
            self.sort(self.column)
        elif key == _Key.Key_Down:
            self.left.emit()
        else:
            super().keyPressEvent(event)

    def focusInEvent(self, event: QFocusEvent) -> None:
        """Frame the chosen column, which is in view."""
        super().focusInEvent(event)
        self._choose(self.column)

    def focusOutEvent(self, event: QFocusEvent) -> None:
        """Remove the frame."""
        super().focusOutEvent(event)
        self.viewport().update()

    def paintSection(self, painter: QPainter, rect: QRect, section: int) -> None:
        """Paint a name, in a frame if the keys have chosen it."""
        super().paintSection(painter, rect, section)
        if self.hasFocus() and section == self.column:
            painter.setPen(QPen(self.palette().highlight().color(), FRAME_PX))
            painter.setBrush(Qt.BrushStyle.NoBrush)
            painter.drawRect(rect.adjusted(1, 1, -FRAME_PX, -FRAME_PX))

    def _take_focus(self, has_columns: bool) -> None:
        policy = Qt.FocusPolicy.TabFocus if has_columns else Qt.FocusPolicy.NoFocus
        self.setFocusPolicy(policy)

    def _choose(self, column: int) -> None:
        self.column = min(max(column, 0), max(self.count() - 1, 0))
        place = self.sectionViewportPosition(self.column)
        beyond = place + self.sectionSize(self.column) - self.viewport().width()
        if place < 0 or beyond > 0:
            self.scroll_requested.emit(place if place < 0 else min(beyond, place))
        self._describe()
        self.viewport().update()

    def _describe(self) -> None:
        """Tell a screen reader the chosen column and the order."""
        name = self._name(self.column)
        by = self.sortIndicatorSection()
        is_rising = self.sortIndicatorOrder() is Qt.SortOrder.AscendingOrder
        order = f"{self._name(by)} {'rising' if is_rising else 'falling'}"
        self.setAccessibleDescription(f"{name}; sorted by {order if by >= 0 else 'recording'}")

    def _name(self, column: int) -> str:
        if not 0 <= column < self.count():
            return ""
        return str(self.model().headerData(column, self.orientation()))


ROW_MARGIN_PX, CELL_MARGIN_PX = 4, 14
_OPENS = (Qt.Key.Key_Return, Qt.Key.Key_Enter)


class TrialTableView(QTableView):
    """Rows to choose from; above the first one the focus goes to the names of the columns."""

    opened = Signal()
    """Return, or a double click on a row."""
    typed = Signal(str)
    """Letters, which Qt would search 24,000 rows for."""
    font_changed = Signal()
    """Rows have the height of other letters; columns follow, as Qt tells their names last."""

    def __init__(self) -> None:
        super().__init__(showGrid=False)
        self.header = SortHeader()
        self.setHorizontalHeader(self.header)
        self.verticalHeader().hide()
        self.verticalHeader().setSectionResizeMode(QHeaderView.ResizeMode.Fixed)
        self.header.setSectionResizeMode(QHeaderView.ResizeMode.Interactive)
        self.setSelectionBehavior(QTableView.SelectionBehavior.SelectRows)
        self.setSelectionMode(QTableView.SelectionMode.ExtendedSelection)
        self.setMinimumHeight(150)
        self.setAlternatingRowColors(True)
        self.setWordWrap(False)
        self.setHorizontalScrollMode(QTableView.ScrollMode.ScrollPerPixel)
        self.setTabKeyNavigation(False)  # Tab leaves a table of 24,000 trials
        self.header.left.connect(self.setFocus)
        bar = self.horizontalScrollBar()
        self.header.scroll_requested.connect(lambda pixels: bar.setValue(bar.value() + pixels))
        self.doubleClicked.connect(lambda _: self.opened.emit())
        self.font_changed.connect(self.fit_columns, Qt.ConnectionType.QueuedConnection)
        self._fit_rows()

    def changeEvent(self, event: QEvent) -> None:
        """Follow the size of the texts."""
        super().changeEvent(event)
        if event.type() == QEvent.Type.FontChange:
            self._fit_rows()
            self.font_changed.emit()

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Open a trial, or go up to the names of the columns; all else is Qt's."""
        row = self.currentIndex().row()
        if event.key() in _OPENS and row >= 0:
            if not event.isAutoRepeat():
                self.opened.emit()
        elif event.key() == Qt.Key.Key_Up and row <= 0 and not event.modifiers():
            self.header.setFocus(Qt.FocusReason.ShortcutFocusReason)
        else:
            super().keyPressEvent(event)

    def fit_columns(self) -> None:
        """Make each column as wide as its name with the mark of sorting, and its widest text."""
        model, metrics = self.model(), self.fontMetrics()
        assert isinstance(model, TrialModel)
        for number, column in enumerate(model.table.columns):
            widest = max(map(metrics.horizontalAdvance, column.widest_texts()), default=0)
            name = self.header.sectionSizeFromContents(number).width()
            self.setColumnWidth(number, max(widest + CELL_MARGIN_PX, name))

    def _fit_rows(self) -> None:
        self.verticalHeader().setDefaultSectionSize(self.fontMetrics().height() + ROW_MARGIN_PX)

    def keyboardSearch(self, search: str) -> None:
        """Pass letters on to the filter."""
        self.typed.emit(search)


REPLAY = "Replay this trial"
REPLAY_TIP = "Play the chosen trial in the live views (Return, or a double click on its row)"
NO_CHOICE = "Choose a trial first"
NO_REPLAY = "Scans of the moving finger have no replay: a click shows the whole scan"
FILTER_TIP = (
    "Words that each trial must contain: a plate, a verdict, the beginning of a reason, or a "
    "number with its unit. For example: A 80mm/s 250g aborted, or #12 for trial 12"
)


class TrialList(QWidget):
    """Trials to choose from; a click on a column's name sorts by it."""

    trial_requested = Signal(int, int)
    """The number of a session and the row of a trial in it."""
    replay_requested = Signal(int, int)
    """As :attr:`trial_requested`."""

    def __init__(self) -> None:
        super().__init__()
        self.filter = QLineEdit(placeholderText="Filter, such as A 80mm/s aborted")
        self.filter.setClearButtonEnabled(True)
        self.filter.setToolTip(FILTER_TIP)
        self.model, self.table = TrialModel(), TrialTableView()
        self.replay_button = push_button(REPLAY, self._replay)
        self.count, self.reason = label("", "muted", wraps=True), label("", "warn", wraps=True)
        self._reasons: dict[tuple[int, int], str] = {}
        self._chosen: tuple[int, int] | None = None
        self._has_replay = True
        self._set_up()
        below = hbox(self.count, self.replay_button)
        self.setLayout(vbox(self.filter, self.table, below, self.reason, spacing=4, tall=1))
        self._show_replay()

    def show_table(self, table: AttemptTable, reasons: dict[tuple[int, int], str]) -> None:
        """Show other trials, or those of the same sessions with new ones.

        ``reasons``: why trials do not count, by session and row.
        """
        self._reasons = reasons
        if [c.name for c in table.columns] != [c.name for c in self.model.table.columns]:
            self.table.horizontalHeader().setSortIndicator(-1, self._ascending)
        self.model.set_table(table)
        if self._chosen is not None and self._chosen[0] > table.session.max(initial=-1):
            self.forget_choice()
        self._show_count()
        self.table.fit_columns()
        self._show_reason()

    def offer_replay(self, has_replay: bool) -> None:
        """Say whether trials of this experiment can be replayed."""
        self._has_replay = has_replay
        self._show_replay()

    def sort_by_keys(self) -> None:
        """Give the focus to the names of the columns."""
        self.table.header.setFocus(Qt.FocusReason.ShortcutFocusReason)

    def filter_by_keys(self) -> None:
        """Give the focus to the filter."""
        self.filter.setFocus(Qt.FocusReason.ShortcutFocusReason)
        self.filter.selectAll()

    @property
    def has_choice(self) -> bool:
        """Whether a trial is chosen."""
        return self._chosen is not None

    @property
    def chosen(self) -> tuple[int, int] | None:
        """Session and row of the chosen trial."""
        return self._chosen

    def forget_choice(self) -> None:
        """Choose no trial."""
        self._chosen = None
        self._show_reason()

    def choose(self, session: int, row: int) -> None:
        """Choose a trial, or the first that is shown where the filter hides it."""
        self.table.selectRow(max(self.model.shown_row(session, row), 0))

    def shown_places(self) -> list[tuple[int, int]]:
        """Return session and row of all trials that the filter lets through."""
        rows, table = self.model.shown_rows, self.model.table
        return list(zip(table.session[rows].tolist(), table.row[rows].tolist(), strict=True))

    def selected_places(self) -> list[tuple[int, int]]:
        """Return session and row of the selected trials."""
        places = self.shown_places()
        rows = sorted(index.row() for index in self.table.selectionModel().selectedRows())
        return [places[row] for row in rows]

    def _set_up(self) -> None:
        table, header = self.table, self.table.horizontalHeader()
        self._ascending = header.sortIndicatorOrder()
        table.setModel(self.model)
        header.setSortIndicator(-1, self._ascending)
        table.setSortingEnabled(True)
        self.reason.hide()
        self.filter.textChanged.connect(self._filter)
        self.filter.returnPressed.connect(self._leave_filter)
        table.typed.connect(self._type)
        table.opened.connect(self._replay)
        self.model.modelReset.connect(self._restore)
        table.selectionModel().currentRowChanged.connect(self._choose)

    def _filter(self, words: str) -> None:
        self.model.set_filter(words)
        self._show_count()

    def _type(self, letters: str) -> None:
        """Go on in the filter with letters that were typed in the table."""
        self.filter.setFocus(Qt.FocusReason.ShortcutFocusReason)
        self.filter.insert(letters)

    def _leave_filter(self) -> None:
        """Go on to the rows: to the chosen one, else the first."""
        self.table.setFocus(Qt.FocusReason.ShortcutFocusReason)
        if not self.table.selectionModel().hasSelection():
            self.table.selectRow(0)

    def _replay(self) -> None:
        if self._chosen is not None and self._has_replay:
            self.replay_requested.emit(*self._chosen)

    def _show_replay(self) -> None:
        """Say why there is nothing to replay."""
        self.replay_button.setEnabled(self._has_replay and self.has_choice)
        reason = NO_CHOICE if self._has_replay else NO_REPLAY
        self.replay_button.setToolTip(REPLAY_TIP if self.replay_button.isEnabled() else reason)

    def _show_count(self) -> None:
        n, total = self.model.rowCount(), len(self.model.table)
        shown = f"{grouped(n)} of " if n < total else ""
        self.count.setText(f"{shown}{grouped(total)} attempts")

    def _restore(self) -> None:
        """Select the chosen trial again after the table changed its order or grew."""
        if self._chosen is None:
            return
        row = self.model.shown_row(*self._chosen)
        selection = self.table.selectionModel()
        selection.blockSignals(True)
        if row >= 0:
            self.table.selectRow(row)
        selection.blockSignals(False)
        self.table.viewport().update()

    def _choose(self, current: QModelIndex) -> None:
        if not current.isValid():
            return
        at = self.model.table_row(current.row())
        table = self.model.table
        self._chosen = int(table.session[at]), int(table.row[at])
        self._show_reason()
        self.trial_requested.emit(*self._chosen)

    def _show_reason(self) -> None:
        reason = self._reasons.get(self._chosen, "") if self._chosen else ""
        self.reason.setText(f"⚠ {reason}" if reason else "")
        self.reason.setVisible(bool(reason))
        self._show_replay()
