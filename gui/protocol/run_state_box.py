"""The state of a run: progress, what comes next, when it ends."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtWidgets import QProgressBar, QVBoxLayout

from gui.widgets.formatting import capitalised, day_time, duration, size
from gui.widgets.labels import label, plain_tooltip, set_property, show_progress, show_text
from gui.widgets.layouts import form_layout
from rigctl.acquisition.protocol.pause_reasons import reason_words
from rigctl.acquisition.rpc.messages import EngineStatus, RecordingStatus, RunStatus

ROWS = ("Progress", "Finishes", "Trial", "Next plate", "Rejected", "Disk", "Session")
MAX_NAME, STAMP = 26, 16
"""Letters of a session's name in one line, and of the time at the end of a longer one."""
_KEPT = ": committed trials are kept"
_STATES = {
    "idle": "No run",
    "running": "Running",
    "prompt": "Waiting for your answer above",
    "paused": "Paused, drum lifted",
    "done": "Done: all trials are on disk",
    "aborted": f"Aborted{_KEPT}",
    "failed": f"Failed{_KEPT}",
}


class RunStateBox(QVBoxLayout):
    """Shows the run that the engine reports; a layout, so that its box follows its height."""

    def __init__(self) -> None:
        super().__init__()
        self.state = label("No run", "heading", wraps=True)
        self.bar = QProgressBar(format="%p %")
        self.rows = {name: label("–", wraps=True) for name in ROWS}
        self.addWidget(self.state)
        self.addWidget(self.bar)
        form = form_layout(3)
        for name, text in self.rows.items():
            form.addRow(label(name, "muted"), text)
        self.addLayout(form)

    def show_status(self, status: EngineStatus) -> None:
        """Show the run of a status."""
        run = status.run
        show_text(self.state, run_sentence(run))
        set_property(self.state, "role", "bad" if run.state == "failed" else "heading")
        planned = run.trials_planned - run.trials_ended_early
        show_progress(self.bar, run.trials_committed, planned)
        texts = {
            "Progress": progress_sentence(run),
            "Finishes": finish_sentence(run),
            "Trial": trial_sentence(run),
            "Next plate": plate_sentence(run),
            "Rejected": f"{run.trials_rejected}" if run.trials_planned else "–",
            "Disk": disk_sentence(status.recording),
        }
        for name, text in texts.items():
            show_text(self.rows[name], text)
        name = Path(run.session).name if run.session else "–"
        self.rows["Session"].setText(name if len(name) <= MAX_NAME else f"…{name[-STAMP:]}")
        self.rows["Session"].setToolTip(plain_tooltip(run.session or ""))


def run_sentence(run: RunStatus) -> str:
    """Return the run's state, with the reasons of a pause."""
    if run.text:
        return f"{capitalised(run.text)}{_KEPT if run.state == 'aborted' else ''}"
    words = _STATES.get(run.state, run.state)
    reasons = reason_words(run.reasons)
    return f"{words} ({reasons})" if reasons else words


def progress_sentence(run: RunStatus) -> str:
    """Return how many trials are committed, and the time left."""
    if not run.trials_planned:
        return "–"
    left = f", {duration(run.eta_s)} left" if run.is_active and run.eta_s is not None else ""
    early = f", {run.trials_ended_early} left out by an early end" if run.trials_ended_early else ""
    return f"{run.trials_committed} of {run.trials_planned} trials{early}{left}"


def finish_sentence(run: RunStatus) -> str:
    """Return the time of day at which the run ends if nothing makes it wait."""
    if not run.is_active or run.eta_s is None:
        return "–"
    return day_time(run.eta_s) + (", plus plate changes" if run.next_plate else "")


def plate_sentence(run: RunStatus) -> str:
    """Return the next change of plates."""
    plate = run.next_plate
    if run.prompt is not None and run.prompt.texture:
        return f"{run.prompt.texture} now"
    if not run.is_active or plate is None:
        return "no other plate" if run.is_active else "–"
    if not plate.trials:
        return f"{plate.texture} after {'the pause' if run.state == 'paused' else 'this trial'}"
    trials = f"{plate.trials} trial{'' if plate.trials == 1 else 's'}"
    return f"{plate.texture} after {trials}, in {duration(plate.left_s)}"


def disk_sentence(recording: RecordingStatus) -> str:
    """Return the free space, and how long it lasts."""
    if not recording.disk_free_bytes:
        return "–"
    hours = recording.hours_left
    left = f", enough for {duration(hours * 3600)}" if hours is not None else ""
    return f"{size(recording.disk_free_bytes)} free{left}"


def trial_sentence(run: RunStatus) -> str:
    """Return the conditions of the present trial."""
    if not run.current:
        return "–"
    trial = run.current
    mounting = f", mounting {trial.mount}" if trial.mount > 1 else ""
    return (
        f"#{run.trial_id or 0}: {trial.texture}, {trial.speed_mm_s:g} mm/s, "
        f"{trial.force_g:g} g, repeat {trial.repeat}{mounting}"
    )
