"""The page of a run: the planned order, the attempts as they come in, and notes; its end."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from PySide6.QtCore import (
    QAbstractTableModel,
    QEvent,
    QModelIndex,
    QPersistentModelIndex,
    Qt,
    Signal,
)
from PySide6.QtGui import QColor, QResizeEvent
from PySide6.QtWidgets import (
    QAbstractItemView,
    QHeaderView,
    QLineEdit,
    QListWidget,
    QTableView,
    QWidget,
)

from gui.analysis.note_box import NO_REASON
from gui.analysis.worker import Worker
from gui.protocol.learning_page import LearningPage
from gui.protocol.protocol_editor import ProtocolEditor
from gui.protocol.run_tasks import (
    BAD,
    COMMITTED,
    ORDER_COLUMNS,
    REPEATED,
    TRIAL_COLUMNS,
    AttemptRow,
    PlanSummary,
    Row,
    SessionNews,
)
from gui.widgets.file_browser import PathKind, browse_button
from gui.widgets.formatting import grouped
from gui.widgets.labels import ElidedLabel, Strip, label, show_text
from gui.widgets.layouts import EventWatch, FlowLayout, PageTabs, container, hbox, push_button, vbox
from gui.widgets.theme import applied_theme, scaled_px
from rigctl.engine.rpc.messages import EngineStatus, RunStatus

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
            if row.verdict.startswith(REPEATED):
                return QColor(theme.muted)
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


MAX_NOTE_LETTERS = 2000
SHOWN_ENDS = 3
_TEXT_PX = 260
_NO_SESSION = "No session: start a run, or open one to add notes."
NO_VERDICT = "there is no trial to mark: choose one that counts, or one that is marked bad"
_NEEDS_TEXT = "Write the note first"
_NEEDS_RUN = "Only during the run of this session"
_TIPS = {
    "note": "During a run it is a mark at this moment, else it is on the session",
    "skip": "Leave out the trial that is chosen in Planned order, else the present one",
}
_NEEDS_TRIAL = {
    "on_trial": "Choose a trial in the table",
    "bad": "Choose a committed trial in the table",
    "good": "Choose a trial that is marked bad in the table",
    "repeat": "Choose a committed trial in the table",
}


MAX_LOOKS = 20
"""Reads of a session whose rows are not on the disk yet, a status apart, after each change."""
LAST_LOOKS = 3
"""Reads after every trial that counts was seen."""


class SessionPage(QWidget):
    """Shows one session: that of the run, or one that was opened for notes.

    The worker reads what is new whenever the run has got further. Trials are marked and notes
    written here: a plain note on the session of a run goes through its engine, which may be
    elsewhere; what is said of a trial goes straight to dated files in the session's folder.
    ``people`` returns the operator.
    """

    command_requested = Signal(str, dict)
    path_requested = Signal(object, object)
    advanced = Signal(str, int, int)
    """The session's folder, its trials that count, and its attempts that are read."""
    reported = Signal(str, str)
    """Kind and text for the event log."""

    def __init__(self, worker: Worker, people: Callable[[], Mapping[str, str]]) -> None:
        super().__init__()
        self._worker, self._people = worker, people
        self._run = RunStatus()
        self._looks = 0
        self._notes: list[dict[str, Any]] = []
        self._written: dict[str, Any] = {}
        """The note that the worker writes."""
        self.folder = ""
        self._is_active = False
        self.heading = ElidedLabel(_NO_SESSION, "heading")
        self.problem = label("", "bad", wraps=True)
        self.early_ends = label("", "muted", wraps=True)
        self.order, self.attempts = OrderModel(ORDER_COLUMNS), AttemptModel()
        self.order_view = table_view(self.order, len(ORDER_COLUMNS) - 1)
        self.attempt_view = table_view(self.attempts, len(TRIAL_COLUMNS) - 1)
        self.learning, self.editor = LearningPage(), ProtocolEditor()
        self.notes = QListWidget()
        self.notes.setWordWrap(True)
        self.text = QLineEdit(maxLength=MAX_NOTE_LETTERS)
        self.text.setPlaceholderText("A note on the session or a trial")
        self.text.setToolTip("What was noticed, or why a trial is bad")
        self._fit_text()
        EventWatch(self, self._fit_text, QEvent.Type.FontChange)
        self.buttons = {
            "note": push_button("Add note", lambda: self._request("", about_trial=False)),
            "on_trial": push_button("Note on trial", lambda: self._request("")),
            "bad": push_button("Mark bad", lambda: self._request("bad")),
            "good": push_button("Mark good", lambda: self._request("good")),
            "repeat": push_button("Repeat", lambda: self._request("bad", repeat=True)),
            "skip": push_button("Skip", self._skip),
        }
        self.open_button = browse_button(
            self.path_requested, PathKind.SESSION, self.open_session, "Open a session …"
        )
        self.tabs = PageTabs()
        self._lay_out()
        self.text.textChanged.connect(lambda _: self._enable())
        self.text.returnPressed.connect(self.buttons["note"].click)
        self.attempt_view.selectionModel().selectionChanged.connect(lambda *_: self._enable())
        self._enable()

    def show_plan(self, plan: PlanSummary) -> None:
        """Show the order in which a protocol would record its trials."""
        self.order.set_texts(plan.order)

    def show_run(self, run: RunStatus) -> None:
        """Allow what the state of the run allows; look for new attempts where it has changed."""
        before, self._run = self._run, run
        if run.session and run.session != before.session:
            self.show_session(run.session)
        is_active = run.is_active and run.session == self.folder
        if is_active != self._is_active:
            self._is_active = is_active
            self._enable()
        if _stage(run) != _stage(before):
            self._looks = MAX_LOOKS
        self.submit()

    def show_news(self, news: SessionNews) -> None:
        """Add what is new in the session."""
        self.show_problem(news.problem)
        if news.problem:
            return
        if news.first == 0:
            chosen = self.chosen
            self.attempts.replace(news.rows)
            self._choose(chosen)
            self.notes.clear()
            self.notes.addItems(news.notes)
        elif news.first == len(self.attempts.rows):
            self.attempts.append(news.rows)
        show_text(self.early_ends, _shown_ends(news.early_ends))
        self.early_ends.setVisible(bool(news.early_ends))
        if self._is_active:
            self.attempt_view.scrollToBottom()
        self._enable()

    def show_problem(self, sentence: str) -> None:
        """Show why something cannot be read or written; empty for nothing."""
        show_text(self.problem, sentence)
        self.problem.setVisible(bool(sentence))

    @property
    def chosen(self) -> AttemptRow | None:
        """The chosen attempt."""
        rows = self.attempt_view.selectionModel().selectedRows()
        return self.attempts.rows[rows[0].row()] if rows else None

    def _choose(self, chosen: AttemptRow | None) -> None:
        key = (chosen.trial_id, chosen.attempt) if chosen else None
        for place, row in enumerate(self.attempts.rows):
            if (row.trial_id, row.attempt) == key:
                self.attempt_view.selectRow(place)

    def _enable(self) -> None:
        """Enable each button that can do something, and say what the others lack."""
        chosen, has_text = self.chosen, bool(self.text.text().strip())
        verdict = chosen.verdict if chosen else ""
        possible = {
            "note": bool(self.folder),
            "on_trial": chosen is not None,
            "bad": verdict == COMMITTED,
            "good": verdict == BAD,
            "repeat": self._is_active and verdict == COMMITTED,
            "skip": self._is_active,
        }
        for name, button in self.buttons.items():
            needs_text = not has_text and name != "skip"
            button.setEnabled(possible[name] and not needs_text)
            needs = "" if possible[name] else self._lack(name)
            button.setToolTip(needs or (_NEEDS_TEXT if needs_text else _TIPS.get(name, "")))

    def _lack(self, name: str) -> str:
        """Return what a button needs before a text."""
        if name in ("repeat", "skip") and not self._is_active:
            return _NEEDS_RUN
        return _NEEDS_TRIAL.get(name, "")

    def mark_by_key(self) -> None:
        """Mark the chosen attempt, else the newest, bad, or good where it is marked bad."""
        row = self.chosen or next(reversed(self.attempts.rows), None)
        marks = {COMMITTED: "bad", BAD: "good"}
        if row is None or row.verdict not in marks:
            self.reported.emit("refused", NO_VERDICT)
            return
        text, about = self.text.text().strip() or NO_REASON, (row.trial_id, row.attempt)
        self._write(text, *about, marks[row.verdict])

    def _skip(self) -> None:
        """Leave out a trial that is to come, or the present one."""
        rows = self.order_view.selectionModel().selectedRows()
        is_chosen = rows and self.tabs.currentWidget() is self.order_view
        self._send("skip", {"trial_id": int(rows[0].data()) if is_chosen else 0})

    def _request(self, mark: str, *, about_trial: bool = True, repeat: bool = False) -> None:
        chosen = self.chosen if about_trial else None
        note: dict[str, Any] = {
            "text": self.text.text().strip(),
            "trial_id": chosen.trial_id if chosen else 0,
            "attempt": chosen.attempt if chosen else 0,
            "mark": mark,
            "repeat": repeat,
        }
        self._take_note(note)

    def finish_task(self, task: str, news: SessionNews) -> None:
        """Show what a task of the worker has read, and log a note that it has written."""
        if task == "write_note":
            self.reported.emit("note", note_line(**self._written))
        if news.folder != self.folder:
            return
        self.show_news(news)
        self.advanced.emit(news.folder, news.committed, len(self.attempts.rows))
        if task == "write_note":
            self.text.clear()
        if news.committed >= self._run.trials_committed:  # an attempt that failed may follow
            self._looks = min(self._looks, LAST_LOOKS)

    def submit(self) -> None:
        """Write the next note, or read what is new, if the worker is free."""
        if self._worker.is_busy:
            return
        if self._notes:
            self._written = self._notes.pop(0)
            self._worker.submit("write_note", **self._written)
        elif self._looks > 0 and self.folder:
            self._looks -= 1
            known = len(self.attempts.rows)
            self._worker.submit("follow_run", folder=self.folder, known=known)

    def open_session(self, folder: str) -> None:
        """Show a session that is not the run's."""
        self.show_session(folder)
        self._looks = 1
        self.submit()

    def show_session(self, folder: str) -> None:
        """Show another session, without rows until they are read."""
        if folder != self.folder:
            self.folder = folder
            self.attempts.clear()
            self.notes.clear()
            self.early_ends.hide()
            self._enable()
        show_text(self.heading, folder or _NO_SESSION)
        self.advanced.emit(folder, 0, 0)

    def _take_note(self, note: dict[str, Any]) -> None:
        is_running = self._run.is_active and self._run.session == self.folder
        if note.pop("repeat"):
            args = {"trial_id": note["trial_id"], "text": note["text"]}
            self._send("repeat", args)
        elif is_running and not note["trial_id"]:
            self._send("note", {"text": note["text"]})
        else:
            self._write(**note)

    def _write(self, text: str, trial_id: int, attempt: int, mark: str) -> None:
        note = {"text": text, "trial_id": trial_id, "attempt": attempt, "mark": mark}
        author = self._people()["operator"]
        self._notes.append({"folder": self.folder, "author": author, **note})
        self.submit()

    def _send(self, command: str, args: dict[str, Any]) -> None:
        self.command_requested.emit(command, args)
        self.text.clear()
        self._looks = MAX_LOOKS

    def _fit_text(self) -> None:
        """Keep room for the hint in the field of the note."""
        self.text.setMinimumWidth(scaled_px(_TEXT_PX))

    def _lay_out(self) -> None:
        self.tabs.addTab(self.attempt_view, "Trials")
        self.tabs.addTab(self.notes, "Notes")
        self.tabs.addTab(self.learning, "Learning curve")
        self.tabs.addTab(self.order_view, "Planned order")
        self.tabs.addTab(self.editor, "Edit protocol")
        self.problem.hide()
        self.early_ends.hide()
        top = hbox(self.heading, self.open_button, spacing=6)
        bottom = FlowLayout(self.text, *self.buttons.values())
        self.setLayout(
            vbox(
                container(top),
                self.tabs,
                self.early_ends,
                self.problem,
                container(bottom),
                spacing=6,
                margins=(6, 2, 6, 2),
                tall=1,
            )
        )


def _shown_ends(ends: tuple[str, ...]) -> str:
    """Return the newest sentences on conditions that ended early, and how many there are."""
    lines = [f"Early ends: {len(ends)}, the newest below"] if len(ends) > SHOWN_ENDS else []
    return "\n".join((*lines, *ends[-SHOWN_ENDS:]))


def note_line(folder: str, author: str, text: str, trial_id: int, attempt: int, mark: str) -> str:
    """Return a line on a note that was added to a session's folder: who, where and what."""
    trial = f", trial {trial_id}, attempt {attempt}" if trial_id else ""
    marked = f" marked {mark}" if mark else ""
    by = f" by {author}" if author else ""
    return f"{Path(folder).name}{trial}{marked}: “{text}”, noted{by}"


def _stage(run: RunStatus) -> tuple[object, ...]:
    """Return what changes when there may be a new attempt."""
    return run.session, run.state, run.trials_committed, run.trials_rejected, run.trial_id


class RunEndStrip(Strip):
    """Names the session of a run that ended while this window watched; hidden otherwise."""

    analyse_requested = Signal(str)
    """The session's folder."""
    continue_requested = Signal(str)
    """The same; its run hides the strip."""

    def __init__(self) -> None:
        super().__init__()
        self.session = ""
        self._watched = ""
        self.analyse_button = push_button("Analyse it", self._analyse)
        self.continue_button = push_button(
            "Continue it",
            lambda: self.continue_requested.emit(self.session),
            PathKind.INTERRUPTED.value[2],
        )
        self.close_button = push_button("Close", self.hide)
        self.lay_out(self.continue_button, self.analyse_button, self.close_button, warns=False)

    def show_status(self, status: EngineStatus) -> None:
        """Watch a run, and offer its session when it ends."""
        run = status.run
        if run.is_active:
            self._watched = run.session or ""
            self.hide()
            return
        watched, self._watched = self._watched, ""
        if watched and run.has_ended and run.session in (None, watched):
            self.session = watched
            name = Path(self.session).name
            self.text.setText(f"The run {name} has ended with {_trials(run)}.")
            self.continue_button.setVisible(not run.is_complete)
            self.show()

    def _analyse(self) -> None:
        self.hide()
        self.analyse_requested.emit(self.session)


def _trials(run: RunStatus) -> str:
    """Return how many trials a run has, and how the rest is recorded."""
    n, planned = run.trials_committed, run.trials_planned
    if n >= planned:
        return "1 trial" if n == 1 else f"{grouped(n)} trials"
    return f"{grouped(n)} of {grouped(planned)} trials"
