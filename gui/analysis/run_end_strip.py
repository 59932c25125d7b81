"""A strip that leads from the end of a run to the analysis of its session."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QFrame

from gui.widgets.formatting import grouped
from gui.widgets.labels import label
from gui.widgets.layouts import hbox, push_button
from rigctl.acquisition.rpc.messages import EngineStatus, RunStatus


class RunEndStrip(QFrame):
    """Names the session of a run that ended while this window watched; hidden otherwise."""

    analyse_requested = Signal(str)
    """The session's folder."""

    def __init__(self) -> None:
        super().__init__()
        self.setProperty("role", "prompt")
        self.session = ""
        self._watched = ""
        self.text = label("", "heading", wraps=True)
        self.analyse_button = push_button("Analyse it", self._analyse)
        self.close_button = push_button("Close", self.hide)
        row = (self.text, self.analyse_button, self.close_button)
        self.setLayout(hbox(*row, spacing=6, margins=(10, 6, 10, 6)))
        self.hide()

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
            self.show()

    def _analyse(self) -> None:
        self.hide()
        self.analyse_requested.emit(self.session)


def _trials(run: RunStatus) -> str:
    """Return how many trials a run has, and how the rest is recorded."""
    n, planned = run.trials_committed, run.trials_planned
    if n >= planned:
        return "1 trial" if n == 1 else f"{grouped(n)} trials"
    rest = "" if run.state == "done" else ": Continue a session … in Protocol records the rest"
    return f"{grouped(n)} of {grouped(planned)} trials{rest}"
