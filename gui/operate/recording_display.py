"""Whether samples reach the disk: a lamp and its words."""

from __future__ import annotations

from PySide6.QtWidgets import QWidget

from gui.widgets.formatting import grouped
from gui.widgets.labels import label, set_property, show_text
from gui.widgets.layouts import container, hbox, vbox
from gui.widgets.status_lamp import Level, StatusLamp
from rigctl.acquisition.rpc.messages import RecordingStatus

UNRECORDED_LIMIT = 12  # statuses, ten a second: longer than the second that the engine judges
_WORDS_PX = 230


class RecordingDisplay(QWidget):
    """The recording lamp; green only while samples reach the disk."""

    def __init__(self) -> None:
        super().__init__()
        self.lamp = StatusLamp(18)
        self.title, self._detail = label("Not recording", "heading"), label("", "muted", wraps=True)
        self._unrecorded = 0
        words = container(vbox(self.title, self._detail))
        words.setFixedWidth(_WORDS_PX)
        self.setLayout(hbox(self.lamp, words, wide=1, spacing=8))

    def show_status(self, run_state: str, recording: RecordingStatus) -> None:
        """Show the recording of a status, given the state of its run."""
        is_missing = run_state == "running" and not recording.active
        self._unrecorded = self._unrecorded + 1 if is_missing else 0
        self.show_recording(*judge_recording(recording, self._unrecorded))

    def show_silent(self) -> None:
        """Show that the last status is out of date."""
        self.show_recording(Level.BAD, "Recording: unknown", "the engine does not answer")

    def show_recording(self, level: Level, title: str, detail: str) -> None:
        """Show a level and its words."""
        self.lamp.set_level(level)
        show_text(self.title, title)
        show_text(self._detail, detail)
        set_property(self.title, "role", "bad" if level is Level.BAD else "heading")


def judge_recording(recording: RecordingStatus, unrecorded: int) -> tuple[Level, str, str]:
    """Return the lamp's level, title and detail; only samples on the disk make it green.

    ``unrecorded`` counts the successive statuses of a running protocol without a recording.
    """
    if recording.failure:
        return Level.BAD, "NOT RECORDING", recording.failure
    if recording.active:
        total = f"{grouped(recording.samples_on_disk)} samples"
        return Level.OK, "Recording", f"{total}, {recording.samples_last_s}/s to disk"
    if unrecorded > UNRECORDED_LIMIT:
        return Level.BAD, "NOT RECORDING", "a protocol is running, but no samples reach the disk"
    return Level.OFF, "Not recording", "no trials are running"
