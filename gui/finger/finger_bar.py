"""The toolbar's page of the finger: choice of the rig, connection, state, recording lamp."""

from __future__ import annotations

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QWidget

from gui.engine_clients import JOIN, SIMULATED
from gui.engine_link import NOT_CONNECTED
from gui.operate.recording_display import RecordingDisplay
from gui.widgets.file_browser import PathKind
from gui.widgets.file_combo_box import FileComboBox
from gui.widgets.labels import elastic, label, set_property, show_text
from gui.widgets.layouts import hbox, push_button, vbox
from gui.widgets.status_lamp import Level
from rigctl.realtime.messages import FingerEngineStatus

RIGS = {
    "Virtual finger": "virtual",
    "Firmware on a simulated chip": "firmware",
    "Join the running engine": JOIN,
}


class FingerBar(QWidget):
    """Emits signals only; it does not know the engine."""

    connect_requested = Signal(str)
    disconnect_requested = Signal()
    rig_changed = Signal()

    def __init__(self) -> None:
        super().__init__()
        self.rig = FileComboBox(RIGS, PathKind.FINGER_FILE, "Open a finger.toml …", 215)
        self.rig.setToolTip("Rig of the moving finger")
        self.rig.currentIndexChanged.connect(lambda _: self.rig_changed.emit())
        self.connect_button = push_button("Connect", self._toggle)
        self.connect_button.setMinimumWidth(104)
        self.state, self.words = label("–", "state"), elastic(label(NOT_CONNECTED, "muted"))
        self.recording_display = RecordingDisplay()
        self._is_connected = False
        state = vbox(self.state, self.words)
        row = (self.rig, self.connect_button, state, self.recording_display)
        self.setLayout(hbox(*row, wide=2, spacing=8))

    @property
    def is_simulated(self) -> bool:
        """Whether the chosen rig is simulated."""
        return self.rig.currentData() in SIMULATED

    def show_connecting(self) -> None:
        """Show that the engine is starting."""
        self._show_connection("Connecting …", connected=False, locked=True)
        self.connect_button.setEnabled(False)
        joins = self.rig.currentData() == JOIN
        starting = f"starting the engine for {self.rig.currentText()} …"
        show_text(self.words, "joining the running engine …" if joins else starting)

    def show_connected(self) -> None:
        """Show that the engine answers."""
        self._show_connection("Disconnect", connected=True, locked=True)

    def show_disconnected(self, reason: str) -> None:
        """Show that there is no engine, and why."""
        self._show_connection("Connect", connected=False, locked=False)
        self.state.setText("–")
        set_property(self.state, "level", "ok")
        show_text(self.words, reason)
        self.recording_display.show_recording(Level.OFF, "Not recording", "")

    def show_silent(self, seconds: float) -> None:
        """Show that the last status is out of date."""
        self.state.setText("?")
        set_property(self.state, "level", "bad")
        show_text(self.words, f"the engine has not answered for {seconds:.0f} s")
        self.recording_display.show_silent()

    def show_status(self, status: FingerEngineStatus) -> None:
        """Show the run's state and the rig, and the recording lamp."""
        run = status.run
        is_whole = status.finger_connected and status.tracker_connected
        self.state.setText(run.state.upper())
        set_property(self.state, "level", "ok" if is_whole and run.state != "failed" else "bad")
        show_text(self.words, _words(status))
        self.recording_display.show_status(run.state, status.recording)

    def _show_connection(self, button: str, *, connected: bool, locked: bool) -> None:
        self._is_connected = connected
        self.connect_button.setText(button)
        self.connect_button.setEnabled(True)
        self.rig.setEnabled(not locked)

    def _toggle(self) -> None:
        if self._is_connected:
            self.disconnect_requested.emit()
        else:
            self.connect_requested.emit(self.rig.currentData())


def _words(status: FingerEngineStatus) -> str:
    if not status.finger_connected:
        return "the finger board is not connected"
    if not status.tracker_connected:
        return "the tracker is not connected"
    return f"{status.rig}; {status.tracker}"
