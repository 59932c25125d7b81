"""The run of the finger's protocol: start, pause, abort, progress, models, rehearsed faults."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QGridLayout, QGroupBox, QProgressBar, QWidget

from gui.widgets.file_browser import PathKind, browse_button
from gui.widgets.formatting import capitalised, duration
from gui.widgets.labels import elastic, label, plain_tooltip, set_property, show_progress, show_text
from gui.widgets.layouts import combo_box, container, form_layout, hbox, push_button, vbox
from rigctl.acquisition.protocol.pause_reasons import reason_words
from rigctl.realtime.messages import FingerEngineStatus, FingerRunStatus

_ROWS = ("Progress", "Stage", "Scan", "Rejected", "Session")
_STATES = {
    "idle": "No run",
    "running": "Running",
    "prompt": "Waiting for your answer above",
    "paused": "Paused",
    "done": "Done: every scan is on disk",
    "aborted": "Aborted: committed scans are kept",
    "failed": "Failed: committed scans are kept",
}
FAULTS: dict[str, dict[str, Any]] = {
    "Lift the finger for 0.5 s": {"fault": "lift", "seconds": 0.5},
    "Stand still for 1 s": {"fault": "stand_still", "seconds": 1.0},
    "Run back": {"fault": "reverse"},
    "Too fast": {"fault": "too_fast"},
    "Stop before the end": {"fault": "short_scan"},
    "Always lay plate C": {"fault": "wrong_plate", "texture": "C"},
    "Hide the tracker for 0.5 s": {"fault": "lose_tracker", "seconds": 0.5},
    "Switch the tracker off": {"fault": "unplug_tracker"},
    "Switch the tracker on": {"fault": "replug_tracker"},
    "Unplug the board": {"fault": "unplug"},
    "Plug in the board": {"fault": "replug"},
}
"""Text of each fault, and the arguments of the engine's command ``inject``."""


class FingerRunBox(QGroupBox):
    """Emits requests, and shows what the engine reports."""

    command_requested = Signal(str, dict)
    start_requested = Signal()
    models_requested = Signal()
    continue_requested = Signal(str)
    path_requested = Signal(object, object)

    def __init__(self) -> None:
        super().__init__("Run")
        self.buttons = {"Start": push_button("Start", self.start_requested.emit)}
        for name in ("Pause", "Resume", "Abort"):
            send = partial(self.command_requested.emit, name.lower(), {})
            self.buttons[name] = push_button(name, send)
        self.continue_button = browse_button(
            self.path_requested,
            PathKind.INTERRUPTED,
            self.continue_requested.emit,
            "Continue …",
        )
        self.models_button = push_button(
            "Make models",
            self.models_requested.emit,
            "Train, or centre by the calibration, the models of the last session",
        )
        self.state, self.models = label("No run", "heading", wraps=True), label("", wraps=True)
        self.bar = QProgressBar(format="%p %")
        self.rows = {name: elastic(label("–")) for name in _ROWS}
        self.fault = combo_box({text: text for text in FAULTS})
        self.inject = push_button("Inject", self._inject)
        self.inject.setAccessibleName("Inject the chosen fault")
        self._fault_row = container(hbox(self.fault, self.inject))
        self._lay_out()

    def show_status(self, status: FingerEngineStatus, can_start: bool, is_busy: bool) -> None:
        """Show the run; ``is_busy``: models are being made, or an engine is starting."""
        run = status.run
        is_free = not run.is_active and not is_busy
        self.buttons["Start"].setEnabled(is_free and can_start)
        self.continue_button.setEnabled(is_free)
        self.models_button.setEnabled(is_free and run.has_ended and run.session is not None)
        self.buttons["Pause"].setEnabled(run.state in ("running", "prompt"))
        self.buttons["Resume"].setEnabled(run.state == "paused")
        self.buttons["Abort"].setEnabled(run.is_active)
        for part in (self._fault_row, self.inject):
            part.setVisible(status.simulated)
        self._show_run(run)

    def show_models(self, text: str, role: str = "") -> None:
        """Show how far the models are."""
        show_text(self.models, text)
        set_property(self.models, "role", role)
        self.models.setVisible(bool(text))

    def _show_run(self, run: FingerRunStatus) -> None:
        show_text(self.state, run_sentence(run))
        set_property(self.state, "role", "bad" if run.state == "failed" else "heading")
        show_progress(self.bar, run.trials_committed, run.trials_planned)
        left = f", {duration(run.eta_s)} left" if run.is_active and run.eta_s is not None else ""
        texts = dict.fromkeys(_ROWS, "–")
        if run.trials_planned:
            texts["Progress"] = f"{run.trials_committed} of {run.trials_planned} scans{left}"
            texts["Rejected"] = str(run.trials_rejected)
        if run.scan is not None:
            texts["Stage"] = run.scan.stage
            texts["Scan"] = f"{run.scan.texture}, {run.scan.profile}, attempt {run.scan.attempt}"
        if run.session is not None:
            texts["Session"] = Path(run.session).name
        for name, text in texts.items():
            show_text(self.rows[name], text)
        self.rows["Session"].setToolTip(plain_tooltip(run.session or ""))

    def _inject(self) -> None:
        self.command_requested.emit("inject", FAULTS[self.fault.currentText()])

    def _lay_out(self) -> None:
        grid = QGridLayout()
        buttons: tuple[QWidget, ...] = (
            *self.buttons.values(),
            self.continue_button,
            self.models_button,
        )
        for place, button in enumerate(buttons):
            grid.addWidget(button, place // 2, place % 2)
        column = vbox(spacing=4, margins=(8, 6, 8, 8))
        column.addLayout(grid)
        column.addWidget(self.state)
        column.addWidget(self.bar)
        form = form_layout(2)
        for name, text in self.rows.items():
            form.addRow(label(name, "muted"), text)
        column.addLayout(form)
        column.addWidget(self.models)
        column.addWidget(self._fault_row)
        self.setLayout(column)
        self.show_models("")


def run_sentence(run: FingerRunStatus) -> str:
    """Return the run's state, with the reasons of a pause."""
    if run.text:
        return capitalised(run.text)
    words = _STATES.get(run.state, run.state)
    reasons = reason_words(run.reasons)
    return f"{words} ({reasons})" if reasons else words
