"""The toolbar's page of the finger: choice of the rig, connection, state, recording lamp."""

from __future__ import annotations

from PySide6.QtCore import Signal

from gui.link.engine_clients import JOIN, SIMULATED
from gui.operate.connection_bar import ConnectionBar
from gui.widgets.file_browser import PathKind
from gui.widgets.file_combo_box import FileComboBox
from gui.widgets.layouts import hbox, vbox
from rigctl.realtime.messages import FingerEngineStatus

RIGS = {
    "Virtual finger": "virtual",
    "Firmware on a simulated chip": "firmware",
    "Join the running engine": JOIN,
}


class FingerBar(ConnectionBar):
    """The connection of a rig of the moving finger."""

    connect_requested = Signal(str)
    rig_changed = Signal()

    def __init__(self) -> None:
        super().__init__(FileComboBox(RIGS, PathKind.FINGER_FILE, "Open a finger.toml …", 215))
        self.rig.set_own_tooltip("Rig of the moving finger")
        self.connect_clicked.connect(self._request_connection)
        self.rig.currentIndexChanged.connect(lambda _: self.rig_changed.emit())
        state = vbox(self.state, self.state_words)
        row = (self.rig, self.connect_button, state, self.recording_display)
        self.setLayout(hbox(*row, wide=2, spacing=8))

    @property
    def is_simulated(self) -> bool:
        """Whether the chosen rig is simulated."""
        return self.rig.currentData() in SIMULATED

    def show_status(self, status: FingerEngineStatus) -> None:
        """Show the run's state and the rig, and the recording lamp."""
        run = status.run
        is_whole = status.finger_connected and status.tracker_connected
        is_good = is_whole and run.state != "failed"
        self._show_state(run.state.upper(), _words(status), is_good=is_good)
        self.recording_display.show_status(run.state, status.recording)

    def _request_connection(self) -> None:
        self.connect_requested.emit(self.rig.currentData())


def _words(status: FingerEngineStatus) -> str:
    if not status.finger_connected:
        return "the finger board is not connected"
    if not status.tracker_connected:
        return "the tracker is not connected"
    return f"{status.rig}; {status.tracker}"
