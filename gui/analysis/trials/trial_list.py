"""The list of trials: a filter, the table, and why the chosen trial does not count."""

from __future__ import annotations

from PySide6.QtCore import QModelIndex, Qt, Signal
from PySide6.QtWidgets import QLineEdit, QWidget

from gui.analysis.trials.trial_model import TrialModel
from gui.analysis.trials.trial_table import AttemptTable
from gui.analysis.trials.trial_table_view import TrialTableView
from gui.widgets.formatting import grouped
from gui.widgets.labels import label
from gui.widgets.layouts import hbox, push_button, vbox

CELL_MARGIN_PX = 14
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
        column = vbox(self.filter, self.table, below, self.reason, spacing=4)
        column.setStretch(1, 1)
        self.setLayout(column)
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
        self._fit_columns()
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

    def forget_choice(self) -> None:
        """Choose no trial."""
        self._chosen = None
        self._show_reason()

    def choose(self, session: int, row: int) -> None:
        """Choose a trial, or the first that is shown where the filter hides it."""
        self.table.selectRow(max(self.model.shown_row(session, row), 0))

    def choose_first(self) -> None:
        """Choose the first trial that is shown."""
        self.table.selectRow(0)

    def selected_rows(self) -> list[tuple[int, int]]:
        """Return session and row of the selected trials, or of all shown if one is selected."""
        chosen = [index.row() for index in self.table.selectionModel().selectedRows()]
        rows = self.model.shown_rows[chosen] if len(chosen) > 1 else self.model.shown_rows
        table = self.model.table
        return list(zip(table.session[rows].tolist(), table.row[rows].tolist(), strict=True))

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
        # Qt tells the names of the columns of the font after the rows.
        queued = Qt.ConnectionType.QueuedConnection
        table.font_changed.connect(self._fit_columns, queued)
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
            self.choose_first()

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

    def _fit_columns(self) -> None:
        """Make each column as wide as its name with the mark of sorting, and its widest text."""
        metrics, header = self.table.fontMetrics(), self.table.horizontalHeader()
        for number, column in enumerate(self.model.table.columns):
            widest = max(map(metrics.horizontalAdvance, column.widest_texts()))
            name = header.sectionSizeFromContents(number).width()
            self.table.setColumnWidth(number, max(widest + CELL_MARGIN_PX, name))

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
