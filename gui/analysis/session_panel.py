"""The Analysis tab's panel: sessions and their trials, and the classification of textures."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from PySide6.QtCore import QEvent, Signal, SignalInstance
from PySide6.QtWidgets import QLineEdit, QWidget

from gui.analysis.note_box import NoteBox
from gui.analysis.run_box import AnalysisRunBox
from gui.analysis.task_values import DRUM, SessionTable
from gui.analysis.trial_list import TrialList
from gui.analysis.trial_table import AttemptTable, join_tables
from gui.widgets.file_browser import PathKind, browse_button
from gui.widgets.labels import label, set_property
from gui.widgets.layouts import EventWatch, container, hbox, push_button, vbox
from rigctl.session.notes import Mark


class SessionPanel(QWidget):
    """Controls for sessions; emits requests for the worker processes, and shows their results."""

    open_requested = Signal(str)
    trial_requested = Signal(str, int)
    """The path of a session and the row of a trial in it."""
    replay_requested = Signal(str, int)
    """The path of a session of the drum and the row of a trial in it."""
    run_requested = Signal(str, str)
    """The key of the method, and the session folder."""
    verify_requested = Signal(str, str)
    """The session folder, and the digest that was kept of it, or nothing."""
    note_requested = Signal(str, int, str, str)
    """The path of a session, the row of a trial in it, a text, and a mark."""
    path_requested = Signal(object, object)
    shown = Signal()
    """The panel has come to the front."""

    def __init__(self) -> None:
        super().__init__()
        self.folder = QLineEdit(placeholderText="Session folder")
        requested = self.path_requested
        self.folder_button = browse_button(requested, PathKind.SESSION, self.open_session)
        self.open_button = push_button("Open", self._open)
        self.about = label("No session is open.", "muted", wraps=True)
        self.missing = label("", "warn", wraps=True)
        self.digest = QLineEdit(readOnly=True, placeholderText="No closing digest")
        self.kept = QLineEdit(placeholderText="Kept digest, if any")
        self.verify_button = push_button("Verify", self._verify)
        self.trials = TrialList()
        self.model, self.table = self.trials.model, self.trials.table
        self.note_box = NoteBox("on this trial", "It stands in the table, in figures and in CSV")
        self.run_box = AnalysisRunBox()
        self.sessions: dict[str, SessionTable] = {}
        self._is_busy = False
        EventWatch(self, self.shown.emit, QEvent.Type.Show)
        self._set_up()
        self._lay_out()
        self.show_idle()

    @property
    def path(self) -> str:
        """The session that was opened first, empty without one."""
        return next(iter(self.sessions), "")

    @property
    def growing(self) -> tuple[str, ...]:
        """The open sessions that are still being recorded."""
        return tuple(path for path, table in self.sessions.items() if table.is_growing)

    def open_session(self, folder: str) -> None:
        """Request the trials of a session folder, in place of the sessions that are open."""
        self.folder.setText(folder)
        self.run_box.form.show_session(folder)
        self.open_requested.emit(folder)

    def show_session(self, table: SessionTable) -> None:
        """Show a session: one that was opened with a trial of it, one beside it, or its growth."""
        first, *added = self.run_box.form.sessions or ("",)
        if table.path in self.sessions and (table.path == self.path or table.path != first):
            self.sessions[table.path] = table
        elif table.path in added and self.path:
            self._add(table)
        else:
            self._show_first(table)
        self._show_trials()
        self._show_digest()
        if not self.trials.has_choice:
            self.trials.choose(0, self.sessions[self.path].first_shown)

    def show_unopened(self, sentence: str) -> None:
        """Show why a session did not open, and nothing of those before."""
        self.sessions = {}
        self.run_box.form.show_session("")
        self.run_box.clear_result()
        self._show_trials()
        self._show_digest()
        self._show_state()
        self.about.setText(sentence)
        set_property(self.about, "role", "bad")

    def selected_trials(self) -> list[tuple[str, int]]:
        """Return path and row of the selected trials."""
        paths = list(self.sessions)
        return [(paths[session], row) for session, row in self.trials.selected_places()]

    def compared_trials(self) -> list[tuple[str, int]]:
        """Return the selected trials, or all shown if one is selected."""
        selected, paths = self.selected_trials(), list(self.sessions)
        if len(selected) > 1:
            return selected
        return [(paths[session], row) for session, row in self.trials.shown_places()]

    def drop_unopened(self) -> None:
        """Forget the added sessions that are not open."""
        for path in self.run_box.form.sessions:
            if path not in self.sessions:
                self.run_box.form.remove_session(path)

    def show_failure(self, sentence: str) -> None:
        """Show why an analysis or the reading of a trial failed."""
        self.show_idle()
        self.run_box.show_refusal(sentence)

    def show_result(self, sentence: str, *, is_alarming: bool) -> None:
        """Show the result of an analysis."""
        self.show_idle()
        self.run_box.show_result(sentence, is_alarming=is_alarming)

    def show_busy(self) -> None:
        """Show that an analysis runs."""
        self._is_busy = True
        self._show_state()

    def show_idle(self) -> None:
        """Show that no analysis runs."""
        self._is_busy = False
        self._show_state()

    def _show_state(self) -> None:
        runnable = any(table.n_rows for table in self.sessions.values())
        self.run_box.show_busy(self._is_busy, runnable)
        self.verify_button.setEnabled(bool(self.sessions) and not self._is_busy)

    def _show_first(self, table: SessionTable) -> None:
        form = self.run_box.form
        self.sessions = {table.path: table}
        self.trials.forget_choice()
        self.run_box.show_experiment(table.experiment)
        if form.sessions[:1] != (table.path,):
            form.show_session(table.path)
        self._keep_sessions(form.sessions)  # with those that were added since it was requested
        self.run_box.show_place(table.path)
        self.run_box.clear_result()
        self.kept.clear()
        self._show_state()

    def _add(self, table: SessionTable) -> None:
        """Show the trials of one more session, if they are of the same experiment."""
        if table.experiment != self.sessions[self.path].experiment:
            self.run_box.form.remove_session(table.path)
            self.show_failure(f"{table.path} is of another experiment than {self.path}: open it")
        else:
            self.sessions[table.path] = table

    def _show_trials(self) -> None:
        tables = list(self.sessions.values())
        names = [Path(path).name for path in self.sessions]
        joined = join_tables(names, [t.columns for t in tables]) if tables else AttemptTable()
        reasons = {(i, row): text for i, t in enumerate(tables) for row, text in t.reasons}
        self.trials.show_table(joined, reasons)
        self._offer_note()
        self.trials.offer_replay(not tables or tables[0].experiment == DRUM)
        growing = ". It is being recorded, and new trials appear"
        lines = [t.about + growing * t.is_growing for t in tables]
        self.about.setText("\n".join(lines) or "No session is open.")
        set_property(self.about, "role", "muted")
        missing = ". ".join(table.missing for table in tables if table.missing)
        self.missing.setText(f"⚠ Incomplete: {missing}.")
        self.missing.setVisible(bool(missing))

    def _offer_note(self) -> None:
        """Offer a note on the chosen trial, and the mark that its verdict allows."""
        if self.trials.chosen is None or not self.sessions:
            self.note_box.show_trial(Mark.NONE)
            return
        session, row = self.trials.chosen
        table = list(self.sessions.values())[session]
        self.note_box.show_trial(table.possible_mark(row), has_trial=True)

    def _note(self, text: str, mark: str) -> None:
        if self.trials.chosen is not None:
            session, row = self.trials.chosen
            self.note_requested.emit(list(self.sessions)[session], row, text, mark)

    def _show_digest(self) -> None:
        table = self.sessions.get(self.path, SessionTable())
        self.digest.setText(table.closing_digest)
        self.digest.setCursorPosition(0)

    def _keep_sessions(self, paths: tuple[str, ...]) -> None:
        """Show the trials of the chosen sessions only, and request those that are new."""
        if not self.path or paths[:1] != (self.path,):
            return
        for path in paths:
            if path not in self.sessions:
                self.open_requested.emit(path)
        kept = {path: table for path, table in self.sessions.items() if path in paths}
        if len(kept) < len(self.sessions):
            self.sessions = kept
            self._show_trials()

    def _set_up(self) -> None:
        self.open_button.setFixedWidth(56)
        self.verify_button.setFixedWidth(64)
        self.digest.setToolTip("The closing digest: rigctl verify --digest compares it")
        self.kept.setToolTip(
            "The closing digest as it was printed when the session was closed; with it, Verify "
            "notices a session that was written anew"
        )
        self.missing.hide()
        self.folder.returnPressed.connect(self._open)
        self.trials.trial_requested.connect(partial(self._request, self.trial_requested))
        self.trials.replay_requested.connect(partial(self._request, self.replay_requested))
        self.trials.trial_requested.connect(lambda *_: self._offer_note())
        self.note_box.written.connect(self._note)
        self.run_box.run_requested.connect(lambda key: self.run_requested.emit(key, self.path))
        self.run_box.path_requested.connect(self.path_requested)
        self.run_box.form.sessions_changed.connect(self._keep_sessions)

    def _open(self) -> None:
        if folder := self.folder.text().strip():
            self.open_session(folder)
        else:
            self.show_unopened("No session is open: choose a session's folder first.")

    def _verify(self) -> None:
        self.verify_requested.emit(self.path, self.kept.text().strip())

    def _request(self, requested: SignalInstance, session: int, row: int) -> None:
        requested.emit(list(self.sessions)[session], row)

    def _lay_out(self) -> None:
        folder = hbox(self.folder, self.folder_button, self.open_button)
        digest = hbox(label("Digest"), self.digest, wide=1)
        verify = container(hbox(self.kept, self.verify_button))
        also = self.run_box.form.session_row
        above = (folder, self.about, self.missing, also, digest, verify)
        rows = (*above, self.trials, self.note_box, self.run_box)
        column = vbox(*rows, spacing=5, margins=(6, 8, 6, 6), tall=len(above))
        self.setLayout(column)
