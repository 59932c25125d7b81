"""Record what is done by hand into a session of its own, with a note."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtCore import QDateTime, Signal
from PySide6.QtWidgets import QGroupBox, QLineEdit

from gui.widgets.file_browser import PathKind, browse_button
from gui.widgets.labels import label, set_property, show_text
from gui.widgets.layouts import form_layout, hbox, push_button
from rigctl.acquisition.rpc.messages import EngineStatus

MAX_NOTE_LETTERS = 500
_TIP = "Record samples, polls and events without a protocol until you end it"


class RecordBox(QGroupBox):
    """Folder, note, and one button that begins and ends a recording by hand."""

    command_requested = Signal(str, dict)
    path_requested = Signal(object, object)
    """Kind of the path, and the function that takes the chosen one."""

    def __init__(self) -> None:
        super().__init__("Record by hand")
        self.folder = QLineEdit(str(Path.home() / "rigctl-sessions"))
        self.folder.setToolTip("Every recording gets a new folder in here")
        self.note = QLineEdit(maxLength=MAX_NOTE_LETTERS, placeholderText="what you try out")
        self.button = push_button("Record", self._toggle, _TIP)
        self.state = label("", "muted", wraps=True)
        self._is_recording = False
        browse = browse_button(self.path_requested, PathKind.OUTPUT, self.folder.setText)
        form = form_layout(4)
        form.setContentsMargins(8, 6, 8, 8)
        form.addRow("Save in", hbox(self.folder, browse))
        form.addRow("Note", self.note)
        form.addRow(self.button)
        form.addRow(self.state)
        self.setLayout(form)

    def show_status(self, status: EngineStatus) -> None:
        """Show whether this recording goes on, and how much of it is on the disk."""
        recording = status.recording
        self._is_recording = recording.by_hand
        self.button.setText("End recording" if self._is_recording else "Record")
        is_possible = status.taxels_connected and not status.run.is_active
        self.button.setEnabled(self._is_recording or is_possible)
        for field in (self.folder, self.note):
            field.setEnabled(not self._is_recording)
        set_property(self.state, "role", "heading" if self._is_recording else "muted")
        name = Path(recording.folder or "").name
        seconds = recording.samples_on_disk / 1000
        show_text(self.state, f"{seconds:.0f} s in {name}" if self._is_recording else "")

    def _toggle(self) -> None:
        if self._is_recording:
            self.command_requested.emit("end_record", {})
            return
        time = QDateTime.currentDateTimeUtc().toString("yyyyMMdd-HHmmss")
        folder = Path(self.folder.text().strip()).expanduser() / f"by-hand-{time}"
        args = {"out": str(folder), "note": self.note.text().strip()}
        self.command_requested.emit("record", args)
