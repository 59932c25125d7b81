"""The toolbar: choice of the rig, connection, drum state, recording lamp and STOP."""

from __future__ import annotations

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QFrame, QPushButton, QStackedWidget, QWidget

from gui.engine_clients import JOIN
from gui.engine_link import NOT_CONNECTED
from gui.operate.recording_display import RecordingDisplay
from gui.widgets.file_browser import PathKind
from gui.widgets.file_combo_box import FileComboBox
from gui.widgets.labels import elastic, label, set_property, show_text
from gui.widgets.layouts import container, hbox, push_button, vbox
from gui.widgets.status_lamp import Level
from rigctl.acquisition.rpc.messages import EngineStatus

RIGS = {
    "Virtual rig": "virtual",
    "Firmware on simulated chips": "firmware",
    "Join the running engine": JOIN,
}
WORLDS = {"Nominal world": ""}


class Toolbar(QFrame):
    """A bar whose buttons only emit signals; it does not know the engine."""

    connect_requested = Signal(str, str)
    """The rig, and the world file of a simulated one."""
    disconnect_requested = Signal()
    stop_requested = Signal()

    def __init__(self) -> None:
        super().__init__()
        self.rig = FileComboBox(RIGS, PathKind.RIG_FILE, "Open a rig.toml …", 205)
        self.rig.setToolTip("Rig to connect to")
        self.world = FileComboBox(WORLDS, PathKind.WORLD_FILE, "Open a world file …", 145)
        self.world.setToolTip("World of a simulated rig: its plates, sensor and mechanics")
        # A running engine that the window joins already has its world.
        self.rig.currentIndexChanged.connect(lambda _: self.world.setHidden(self._joins))
        self.connect_button = push_button("Connect", self._toggle_connection)
        self.connect_button.setMinimumWidth(104)
        self.state, self.state_words = label("–", "state"), elastic(label(NOT_CONNECTED, "muted"))
        self.recording_display = RecordingDisplay()
        self.recording_lamp = self.recording_display.lamp
        self.recording = self.recording_display.title
        self.stop_button = QPushButton("STOP")
        self.stop_button.setObjectName("stop")
        self.stop_button.setMinimumSize(150, 46)
        self.stop_button.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self.stop_button.setToolTip("Stop and lift the drum, and end every run (Esc)")
        self.stop_button.pressed.connect(self.stop_requested)
        self.pages = QStackedWidget()
        self._is_connected = False
        self._lay_out()

    @property
    def _joins(self) -> bool:
        return bool(self.rig.currentData() == JOIN)

    def show_connecting(self) -> None:
        """Show that the chosen rig's engine is starting."""
        self._show_connection("Connecting …", connected=False, locked=True)
        self.connect_button.setEnabled(False)
        starting = f"starting the engine for {self.rig.currentText()} …"
        show_text(self.state_words, "joining the running engine …" if self._joins else starting)

    def show_connected(self) -> None:
        """Show that the engine answers."""
        self._show_connection("Disconnect", connected=True, locked=True)

    def show_disconnected(self, reason: str) -> None:
        """Show that there is no engine, and why."""
        self._show_connection("Connect", connected=False, locked=False)
        self.state.setText("–")
        set_property(self.state, "level", "ok")
        show_text(self.state_words, reason)
        self.recording_display.show_recording(Level.OFF, "Not recording", "")

    def show_silent(self, seconds: float) -> None:
        """Show that the last status is out of date: the engine does not answer."""
        self.state.setText("?")
        set_property(self.state, "level", "bad")
        show_text(self.state_words, f"the engine has not answered for {seconds:.0f} s")
        self.recording_display.show_silent()

    def show_status(self, status: EngineStatus) -> None:
        """Show the drum's state and the recording lamp."""
        name = status.state.name.replace("_", " ") if status.state is not None else "–"
        self.state.setText(name)
        set_property(self.state, "level", "bad" if status.fault else "ok")
        show_text(self.state_words, _state_words(status))
        self.recording_display.show_status(status.run.state, status.recording)

    def _show_connection(self, button: str, *, connected: bool, locked: bool) -> None:
        self._is_connected = connected
        self.connect_button.setText(button)
        self.connect_button.setEnabled(True)
        self.rig.setEnabled(not locked)
        self.world.setEnabled(not locked)

    def _toggle_connection(self) -> None:
        if self._is_connected:
            self.disconnect_requested.emit()
        else:
            world = "" if self._joins else self.world.currentData()
            self.connect_requested.emit(self.rig.currentData(), world)

    def add_page(self, page: QWidget) -> None:
        """Add what another experiment shows in the place of rig, state and recording."""
        self.pages.addWidget(page)

    def _lay_out(self) -> None:
        state = vbox(self.state, self.state_words)
        left = (self.rig, self.world, self.connect_button)
        row = hbox(*left, state, self.recording_display, wide=3, spacing=8)
        row.insertSpacing(3, 10)
        self.pages.addWidget(container(row))
        self.setLayout(hbox(self.pages, self.stop_button, wide=0, spacing=8, margins=(8, 5, 8, 5)))


def _state_words(status: EngineStatus) -> str:
    if status.fault:
        return status.fault_words
    if not status.drum_connected:
        return "the drum board is not connected"
    return status.state_words
