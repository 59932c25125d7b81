"""Record what is done by hand into a session of its own, with a note."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtCore import QDateTime, Signal
from PySide6.QtWidgets import QGroupBox, QLineEdit

from gui.widgets.file_browser import PathKind, browse_button
from gui.widgets.labels import label, set_property, show_text
from gui.widgets.layouts import form_layout, hbox, push_button
from gui.widgets.typed_paths import folder_problem, new_files_folder
from rigctl.acquisition.rpc.messages import EngineStatus, RecordingStatus

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
        self._recording, self._is_possible = RecordingStatus(), False
        self.folder.textChanged.connect(lambda _: self._show())
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
        self._recording = status.recording
        self._is_possible = status.taxels_connected and not status.run.is_active
        self._show()

    def _show(self) -> None:
        is_recording = self._recording.by_hand
        problem = "" if is_recording else folder_problem(self.folder.text())
        self.button.setText("End recording" if is_recording else "Record")
        self.button.setEnabled(is_recording or (self._is_possible and not problem))
        for field in (self.folder, self.note):
            field.setEnabled(not is_recording)
        set_property(self.state, "role", "heading" if is_recording else "bad")
        name = Path(self._recording.folder or "").name
        seconds = self._recording.samples_on_disk / 1000
        text = f"{seconds:.0f} s in {name}" if is_recording else ""
        show_text(self.state, f"Save in: {problem}" if problem else text)

    def _toggle(self) -> None:
        if self._recording.by_hand:
            self.command_requested.emit("end_record", {})
            return
        time = QDateTime.currentDateTimeUtc().toString("yyyyMMdd-HHmmss")
        folder = new_files_folder(self.folder.text()) / f"by-hand-{time}"
        args = {"out": str(folder), "note": self.note.text().strip()}
        self.command_requested.emit("record", args)
