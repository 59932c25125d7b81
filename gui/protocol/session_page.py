"""The page of a run: the planned order, the attempts as they come in, and notes."""

from __future__ import annotations

from typing import Any

from PySide6.QtCore import QEvent, Signal
from PySide6.QtWidgets import QLineEdit, QListWidget, QWidget

from gui.protocol.editor.protocol_editor import ProtocolEditor
from gui.protocol.learning_page import LearningPage
from gui.protocol.rows_table import AttemptModel, OrderModel, table_view
from gui.protocol.run_values import (
    BAD,
    COMMITTED,
    ORDER_COLUMNS,
    TRIAL_COLUMNS,
    AttemptRow,
    PlanSummary,
    SessionNews,
)
from gui.widgets.file_browser import PathKind, browse_button
from gui.widgets.flow_layout import FlowLayout
from gui.widgets.labels import ElidedLabel, label, show_text
from gui.widgets.layouts import container, hbox, push_button, vbox
from gui.widgets.page_tabs import PageTabs
from gui.widgets.theme import scaled_px
from rigctl.acquisition.rpc.messages import RunStatus

MAX_NOTE_LETTERS = 2000
SHOWN_ENDS = 3
_TEXT_PX = 260
_NO_SESSION = "No session: start a run, or open one to add notes."
_NEEDS_TEXT = "Write the note first"
_NEEDS_RUN = "Only during the run of this session"
_NEEDS_TRIAL = {
    "bad": "Choose a committed trial in the table",
    "good": "Choose a trial that is marked bad in the table",
    "repeat": "Choose a committed trial in the table",
}


class SessionPage(QWidget):
    """Shows one session: that of the run, or one that was opened for notes.

    Trials are marked and notes written here; what is written goes to dated files beside the parts.
    """

    note_requested = Signal(dict)
    """Text, trial_id, attempt and mark of a note; ``repeat`` asks for the trial once more."""
    path_requested = Signal(object, object)
    opened = Signal(str)
    """Folder of a session that the user opened."""

    def __init__(self) -> None:
        super().__init__()
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
        self.text.setMinimumWidth(scaled_px(_TEXT_PX))
        self.buttons = {
            "note": push_button("Add note", lambda: self._request("", about_trial=False)),
            "bad": push_button("Mark bad", lambda: self._request("bad")),
            "good": push_button("Mark good", lambda: self._request("good")),
            "repeat": push_button("Repeat", lambda: self._request("bad", repeat=True)),
        }
        self.open_button = browse_button(
            self.path_requested, PathKind.SESSION, self.opened.emit, "Open a session …"
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

    def show_session(self, folder: str) -> None:
        """Show another session, without rows until :meth:`show_news` gets them."""
        if folder != self.folder:
            self.folder = folder
            self.attempts.clear()
            self.notes.clear()
            self.early_ends.hide()
            self._enable()
        show_text(self.heading, folder or _NO_SESSION)

    def show_run(self, run: RunStatus) -> None:
        """Allow what the state of the run allows."""
        is_active = run.is_active and run.session == self.folder
        if is_active != self._is_active:
            self._is_active = is_active
            self._enable()

    def show_news(self, news: SessionNews) -> None:
        """Add what is new in the session."""
        if news.folder != self.folder:
            return
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

    def finish_note(self) -> None:
        """Clear the text of a note that was written."""
        self.text.clear()

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
            "bad": verdict == COMMITTED,
            "good": verdict == BAD,
            "repeat": self._is_active and verdict == COMMITTED,
        }
        for name, button in self.buttons.items():
            button.setEnabled(possible[name] and has_text)
            needs = "" if possible[name] else self._lack(name)
            button.setToolTip(needs or ("" if has_text else _NEEDS_TEXT))

    def _lack(self, name: str) -> str:
        """Return what a button needs before a text."""
        if name == "repeat" and not self._is_active:
            return _NEEDS_RUN
        return _NEEDS_TRIAL.get(name, "")

    def _request(self, mark: str, *, about_trial: bool = True, repeat: bool = False) -> None:
        chosen = self.chosen if about_trial else None
        note: dict[str, Any] = {
            "text": self.text.text().strip(),
            "trial_id": chosen.trial_id if chosen else 0,
            "attempt": chosen.attempt if chosen else 0,
            "mark": mark,
            "repeat": repeat,
        }
        self.note_requested.emit(note)

    def changeEvent(self, event: QEvent) -> None:
        """Keep room for the hint in the field of the note when the size of the texts changes."""
        super().changeEvent(event)
        if event.type() in (QEvent.Type.FontChange, QEvent.Type.ApplicationFontChange):
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
        column = vbox(
            container(top), self.tabs, self.early_ends, self.problem, container(bottom), spacing=6,
            margins=(6, 2, 6, 2),
        )  # fmt: skip
        column.setStretch(1, 1)
        self.setLayout(column)


def _shown_ends(ends: tuple[str, ...]) -> str:
    """Return the newest sentences on conditions that ended early, and how many there are."""
    lines = [f"Early ends: {len(ends)}, the newest below"] if len(ends) > SHOWN_ENDS else []
    return "\n".join((*lines, *ends[-SHOWN_ENDS:]))
