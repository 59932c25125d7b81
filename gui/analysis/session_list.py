"""The list of sessions below a folder: who recorded what, how far it is, and what to do with it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from datetime import datetime
from pathlib import Path

import numpy as np
from PySide6.QtCore import QItemSelectionModel, Qt, Signal
from PySide6.QtGui import QAction
from PySide6.QtWidgets import QLineEdit, QWidget

from gui.analysis.trial_list import TrialModel, TrialTableView
from gui.analysis.trial_table import AttemptColumn, AttemptTable
from gui.widgets.file_browser import PathKind, browse_button
from gui.widgets.formatting import grouped
from gui.widgets.labels import label, set_property, show_text
from gui.widgets.layouts import FlowLayout, container, hbox, push_button, vbox
from gui.widgets.typed_paths import typed_path
from rigctl.experiments import DRUM_EXPERIMENT
from rigctl.values import INCOMPLETE, UNREADABLE, SessionLine

BATCH = 10
"""Sessions that are read at a time, half a second: what else the worker is asked comes between."""
FILTER_TIP = (
    "Words that each session must contain: a beginning of its date, name, protocol, operator or "
    "state. For example: 2026-11 incomplete, or Mia simulated"
)
NONE_CHOSEN = "Choose a session in the list"
WHOLE = "All planned trials are recorded"
ONE = "Choose one session; `rigctl export` takes several"
SEVERAL = "Choose two or more sessions of the drum (Ctrl, Shift)"
_MB = 1e6
_Selection = QItemSelectionModel.SelectionFlag
_ADD_ROW = _Selection.Select | _Selection.Rows


class SessionList(QWidget):
    """A page that lists sessions; the worker reads their headers, a few at a time.

    ``verified`` returns when the window found a session whole, empty where it did not.
    """

    task_requested = Signal(str, dict)
    """A task of the worker that reads sessions, and its arguments."""
    continue_requested = Signal(str, str)
    """The path of a session, and its experiment."""
    analyse_requested = Signal(str)
    add_requested = Signal(str)
    overlay_requested = Signal(tuple)
    """The paths of two or more sessions of the drum."""
    table_requested = Signal(str)
    export_requested = Signal(str)
    path_requested = Signal(object, object)
    closed = Signal()

    def __init__(self) -> None:
        super().__init__()
        self.verified: Callable[[SessionLine], str] = lambda _: ""
        self.lines: list[SessionLine] = []
        self._cells: dict[SessionLine, _Cells] = {}
        """Of each session that is shown: with all of them made anew, each batch took longer."""
        self._waiting: list[str] = []
        self._searched = ""
        self.folder = QLineEdit(placeholderText="Folder that holds the sessions")
        self.folder.returnPressed.connect(self.search)
        self.browse = browse_button(self.path_requested, PathKind.DATA, self._choose_folder)
        self.filter = QLineEdit(placeholderText="Filter, such as Mia incomplete")
        self.filter.setClearButtonEnabled(True)
        self.filter.setToolTip(FILTER_TIP)
        self.model, self.table = TrialModel(), TrialTableView()
        self.table.setModel(self.model)
        self.count, self.reason = label("", "muted"), label("", "warn", wraps=True)
        self.buttons = {
            "Continue": push_button("Continue", self._continue),
            "Analyse": push_button("Analyse", self._analyse),
            "Add": push_button("Add", self._add),
            "Lay over": push_button("Lay over", self._lay_over),
            "Table": push_button("Table", self._write_tables),
            "Export": push_button("Export", self._export),
        }
        self.row_menu = {name: QAction(name, self.table) for name in self.buttons}
        self.refresh_button = push_button("Look again", self.search)
        self.close_button = push_button("Close", self.closed.emit)
        self._set_up()
        self._lay_out()
        self._enable()

    def show_folder(self, folder: str) -> None:
        """List the sessions of a folder, unless the user has chosen another one here."""
        if not self._searched:
            self.folder.setText(folder)
        self.search()

    def search(self) -> None:
        """Look for sessions anew."""
        self._searched = self.folder.text().strip()
        if self._searched:
            self._waiting = []
            self.task_requested.emit("find_sessions", {"folder": str(typed_path(self._searched))})

    def show_found(self, paths: tuple[str, ...]) -> None:
        """Begin to read the sessions that were found; those of before stay until then."""
        self._show_lines([line for line in self.lines if line.path in paths])
        self._waiting = list(paths)
        self._read_next()

    def show_lines(self, lines: tuple[SessionLine, ...]) -> None:
        """Show sessions that were read, in place of what was known of them; read the next ones."""
        new = {line.path: line for line in lines}
        kept = [new.pop(line.path, line) for line in self.lines]
        self._show_lines([*kept, *new.values()])
        self._read_next()

    def show_failure(self, sentence: str) -> None:
        """Show why there is no list."""
        self._show_lines([])
        show_text(self.count, sentence)
        set_property(self.count, "role", "bad")

    def show_verified(self) -> None:
        """Show anew which sessions were found whole."""
        self._cells.clear()
        self._show_lines(self.lines)

    @property
    def chosen(self) -> list[SessionLine]:
        """The chosen sessions, in the order of the table."""
        rows = sorted(index.row() for index in self.table.selectionModel().selectedRows())
        return [self.lines[self.model.table_row(row)] for row in rows]

    def _read_next(self) -> None:
        batch, self._waiting = self._waiting[:BATCH], self._waiting[BATCH:]
        if batch:
            self.task_requested.emit("read_session_lines", {"paths": tuple(batch)})
        self._show_count()

    def _show_lines(self, lines: list[SessionLine]) -> None:
        chosen = {line.path for line in self.chosen}
        lines = sorted(lines, key=lambda line: line.start_utc, reverse=True)
        self.lines = lines
        self._cells = {line: self._cells.get(line) or self._cells_of(line) for line in lines}
        self.model.set_table(session_table(tuple(self._cells.values())))
        self.table.fit_columns()
        for row, at in enumerate(self.model.shown_rows.tolist()):
            if lines[at].path in chosen:
                self.table.selectionModel().select(self.model.index(row, 0), _ADD_ROW)
        self._show_count()
        self._enable()

    def _cells_of(self, line: SessionLine) -> _Cells:
        return (
            _local(line.start_utc),
            Path(line.path).name,
            *(line.protocol or "–", line.operator or "–", line.sensor or "–"),
            *(line.plate_lot or "–", line.project or "–"),
            _progress(line),
            line.marked_bad,
            line.state,
            self.verified(line) or "–",
            _rig(line),
            round(line.bytes / _MB, 1),
        )

    def _show_count(self) -> None:
        shown, n = len(self.model.shown_rows), len(self.lines)
        text = f"{grouped(n)} session{'' if n == 1 else 's'}"
        if shown < n:
            text = f"{grouped(shown)} of {text}"
        if self._waiting:
            text += f", {grouped(len(self._waiting))} more are being read …"
        show_text(self.count, text)
        set_property(self.count, "role", "muted")

    def _enable(self) -> None:
        """Enable what can be done with the chosen sessions, and say what the rest lacks."""
        chosen = self.chosen
        reasons = [line.reason for line in chosen if line.reason]
        show_text(self.reason, f"⚠ {reasons[0]}" if len(chosen) == 1 and reasons else "")
        self.reason.setVisible(bool(self.reason.text()))
        readable = bool(chosen) and all(line.state != UNREADABLE for line in chosen)
        kinds = {line.experiment for line in chosen}
        one = chosen[0] if len(chosen) == 1 else None
        can_go_on = one is not None and one.trials_committed < one.trials_planned
        possible = {
            "Continue": can_go_on and one is not None and one.state == INCOMPLETE,
            "Analyse": readable,
            "Add": readable,
            "Lay over": readable and len(chosen) > 1 and kinds == {DRUM_EXPERIMENT},
            "Table": readable,
            "Export": readable and one is not None,
        }
        for name, button in self.buttons.items():
            button.setEnabled(possible[name])
            self.row_menu[name].setEnabled(possible[name])
            lacks = {"Continue": WHOLE if one else NONE_CHOSEN, "Lay over": SEVERAL}
            lacks["Export"] = ONE if len(chosen) > 1 else NONE_CHOSEN
            button.setToolTip(_TIPS[name] if possible[name] else lacks.get(name, NONE_CHOSEN))

    def _continue(self) -> None:
        line = self.chosen[0]
        self.continue_requested.emit(line.path, line.experiment)

    def _analyse(self) -> None:
        """Open the first chosen session, and the others beside it."""
        first, *others = self.chosen
        self.analyse_requested.emit(first.path)
        for line in others:
            self.add_requested.emit(line.path)

    def _add(self) -> None:
        for line in self.chosen:
            self.add_requested.emit(line.path)

    def _lay_over(self) -> None:
        self.overlay_requested.emit(tuple(line.path for line in self.chosen))

    def _write_tables(self) -> None:
        for line in self.chosen:
            self.table_requested.emit(line.path)

    def _export(self) -> None:
        self.export_requested.emit(self.chosen[0].path)

    def _choose_folder(self, folder: str) -> None:
        self.folder.setText(folder)
        self.search()

    def _set_up(self) -> None:
        self.table.header.setSortIndicator(-1, Qt.SortOrder.AscendingOrder)
        self.table.setSortingEnabled(True)
        self.table.selectionModel().selectionChanged.connect(lambda *_: self._enable())
        self.table.opened.connect(self.buttons["Analyse"].click)
        self.table.typed.connect(self._type)
        self.filter.textChanged.connect(self._filter)
        self.filter.returnPressed.connect(self.table.setFocus)
        self.table.setContextMenuPolicy(Qt.ContextMenuPolicy.ActionsContextMenu)
        for name, button in self.buttons.items():
            self.row_menu[name].triggered.connect(button.click)
            self.table.addAction(self.row_menu[name])

    def _filter(self, words: str) -> None:
        self.model.set_filter(words)
        self._show_count()
        self._enable()

    def _type(self, letters: str) -> None:
        """Take letters that were typed in the table."""
        self.filter.setFocus(Qt.FocusReason.ShortcutFocusReason)
        self.filter.setText(letters)

    def _lay_out(self) -> None:
        place = hbox(label("Sessions in"), self.folder, self.browse, self.refresh_button, wide=1)
        below = container(FlowLayout(*self.buttons.values(), self.close_button))
        rows = (label("Sessions", "heading"), place, self.filter, self.table, self.count)
        column = vbox(*rows, self.reason, below, spacing=6, margins=(9, 4, 9, 4), tall=3)
        self.setLayout(column)


_TIPS = {
    "Continue": "Record the remaining trials on the connected rig",
    "Analyse": "Open the chosen sessions in Analysis (Return, or a double click on a row)",
    "Add": "Add the chosen sessions to those that are open in Analysis",
    "Lay over": "Show a trial of one plate, speed and force of each chosen session in one plot",
    "Table": "Write all attempts with their notes as a table (CSV) beside the session",
    "Export": "Write the session for other programs: NWB, MATLAB, Parquet, Neo, CSV",
}


_Cells = tuple[str | float, ...]
_COLUMNS = {
    "Date": "Start, local time",
    **dict.fromkeys(("Session", "Protocol", "Operator", "Sensor", "Plate lot", "Project"), ""),
    "Trials": "Committed, of those planned",
    "Bad": "Attempts that a note marks bad",
    "State": "Whether all planned trials are there",
    "Verified": "When Verify found it whole",
    "Rig": "What recorded it",
    "MB": "Size of the parts",
}
"""Each column, and what it means."""
_NUMBERS = ("Bad", "MB")


def session_table(rows: Sequence[_Cells]) -> AttemptTable:
    """Return the list of sessions from the cells of each, in the order of the columns."""
    cells = zip(*rows, strict=True) if rows else ((),) * len(_COLUMNS)
    columns = (
        AttemptColumn(name, np.array(values), (), meaning)
        if name in _NUMBERS
        else AttemptColumn.of_texts(name, values, meaning)
        for (name, meaning), values in zip(_COLUMNS.items(), cells, strict=True)
    )
    n = np.arange(len(rows), dtype=np.int64)
    return AttemptTable(tuple(columns), np.zeros_like(n), n)


def _local(start_utc: str) -> str:
    """Return a time in the clock of this computer; what is no time stays as it is."""
    try:
        return f"{datetime.fromisoformat(start_utc).astimezone():%Y-%m-%d %H:%M}"
    except ValueError:
        return start_utc or "–"


def _progress(line: SessionLine) -> str:
    if line.state == UNREADABLE:
        return "–"
    return f"{line.trials_committed} of {line.trials_planned}"


def _rig(line: SessionLine) -> str:
    """Return the kind of rig; a simulated one is said to be, whatever its name."""
    what = {DRUM_EXPERIMENT: "", "": ""}.get(line.experiment, f" {line.experiment}")
    return f"simulated{what} ({line.rig})" if line.simulated else f"{line.rig}{what}"
