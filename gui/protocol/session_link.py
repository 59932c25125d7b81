"""Keeps the page of a run up to date: reads the session as it grows, and writes notes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from PySide6.QtCore import QObject, Signal

from gui.analysis.tasks.worker import Worker
from gui.protocol.run_values import SessionNews
from gui.protocol.session_page import SessionPage
from rigctl.acquisition.rpc.messages import RunStatus

MAX_LOOKS = 20
"""Reads of a session whose rows are not on the disk yet, a status apart, after each change."""


LAST_LOOKS = 3
"""Reads after every trial that counts was seen."""


class SessionLink(QObject):
    """Reads what is new in a worker process whenever the run has got further.

    ``people`` returns the operator. A plain note on the session of a run goes through its engine,
    which may be elsewhere; what is said of a trial goes straight to the session's folder.
    """

    command_requested = Signal(str, dict)
    advanced = Signal(str, int, int)
    """The session's folder, its trials that count, and its attempts that are read."""
    reported = Signal(str, str)
    """Kind and text for the event log."""

    def __init__(
        self, worker: Worker, page: SessionPage, people: Callable[[], Mapping[str, str]]
    ) -> None:
        super().__init__()
        self._worker = worker
        self._page = page
        self._people = people
        self._run = RunStatus()
        self._looks = 0
        self._notes: list[dict[str, Any]] = []
        self._written: dict[str, Any] = {}
        """The note that the worker writes."""
        page.note_requested.connect(self._take_note)
        page.opened.connect(self._open)

    def show_run(self, run: RunStatus) -> None:
        """Look for new attempts where the run has changed."""
        before, self._run = self._run, run
        if run.session and run.session != before.session:
            self._show_session(run.session)
        self._page.show_run(run)
        if _stage(run) != _stage(before):
            self._looks = MAX_LOOKS
        self.submit()

    def finish_task(self, task: str, news: SessionNews) -> None:
        """Show what a task of the worker has read, and log a note that it has written."""
        if task == "write_note":
            self.reported.emit("note", note_line(**self._written))
        if news.folder != self._page.folder:
            return
        self._page.show_news(news)
        self.advanced.emit(news.folder, news.committed, len(self._page.attempts.rows))
        if task == "write_note":
            self._page.finish_note()
        if news.committed >= self._run.trials_committed:  # an attempt that failed may follow
            self._looks = min(self._looks, LAST_LOOKS)

    def fail_task(self, sentence: str) -> None:
        """Show why a task failed."""
        self._page.show_problem(sentence)

    def submit(self) -> None:
        """Write the next note, or read what is new, if the worker is free."""
        if self._worker.is_busy:
            return
        if self._notes:
            self._written = self._notes.pop(0)
            self._worker.submit("write_note", **self._written)
        elif self._looks > 0 and self._page.folder:
            self._looks -= 1
            known = len(self._page.attempts.rows)
            self._worker.submit("follow_run", folder=self._page.folder, known=known)

    def _open(self, folder: str) -> None:
        """Show a session that is not the run's."""
        self._show_session(folder)
        self._looks = 1
        self.submit()

    def _show_session(self, folder: str) -> None:
        self._page.show_session(folder)
        self.advanced.emit(folder, 0, 0)

    def _take_note(self, note: dict[str, Any]) -> None:
        is_running = self._run.is_active and self._run.session == self._page.folder
        if note.pop("repeat"):
            args = {"trial_id": note["trial_id"], "text": note["text"]}
            self._send("repeat", args)
        elif is_running and not note["trial_id"]:
            self._send("note", {"text": note["text"]})
        else:
            author = self._people()["operator"]
            self._notes.append({"folder": self._page.folder, "author": author, **note})
            self.submit()

    def _send(self, command: str, args: dict[str, Any]) -> None:
        self.command_requested.emit(command, args)
        self._page.finish_note()
        self._looks = MAX_LOOKS


def note_line(folder: str, author: str, text: str, trial_id: int, attempt: int, mark: str) -> str:
    """Return a line on a note that was added to a session's folder: who, where and what."""
    trial = f", trial {trial_id}, attempt {attempt}" if trial_id else ""
    marked = f" marked {mark}" if mark else ""
    by = f" by {author}" if author else ""
    return f"{Path(folder).name}{trial}{marked}: “{text}”, noted{by}"


def _stage(run: RunStatus) -> tuple[object, ...]:
    """Return what changes when there may be a new attempt."""
    return run.session, run.state, run.trials_committed, run.trials_rejected, run.trial_id
