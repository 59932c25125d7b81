"""The toolbar: choice of the rig, connection, drum state, recording lamp and STOP."""

from __future__ import annotations

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QStackedWidget, QWidget

from gui.link.engine_clients import JOIN
from gui.operate.connection_bar import ConnectionBar
from gui.widgets.file_browser import PathKind
from gui.widgets.file_combo_box import FileComboBox
from gui.widgets.layouts import container, hbox, vbox
from gui.widgets.stop_button import StopButton
from rigctl.acquisition.rpc.messages import EngineStatus
from rigctl.wire.drum.states import Fault

RIGS = {
    "Virtual rig": "virtual",
    "Firmware on simulated chips": "firmware",
    "Join the running engine": JOIN,
}
STILL_IN_CONTACT = "still in contact"
WORLDS = {"Nominal world": ""}


class Toolbar(ConnectionBar):
    """The connection of a drum rig, its world, and STOP."""

    connect_requested = Signal(str, str)
    """The rig, and the world file of a simulated one."""
    stop_requested = Signal()

    def __init__(self) -> None:
        super().__init__(FileComboBox(RIGS, PathKind.RIG_FILE, "Open a rig.toml …", 205))
        self.rig.set_own_tooltip("Rig to connect to")
        self.world = FileComboBox(WORLDS, PathKind.WORLD_FILE, "Open a world file …", 145)
        self.world.set_own_tooltip("World of a simulated rig: its plates, sensor and mechanics")
        # A running engine that the window joins already has its world.
        self.rig.currentIndexChanged.connect(lambda _: self.world.setHidden(self._joins))
        self.recording_lamp = self.recording_display.lamp
        self.recording = self.recording_display.title
        self.stop_button = StopButton()
        self.stop_button.pressed.connect(self.stop_requested)
        self.pages = QStackedWidget()
        self.connect_clicked.connect(self._request_connection)
        self._lay_out()

    @property
    def chosen_world(self) -> str:
        """The world file, empty for the nominal world and for a joined engine."""
        return "" if self._joins else str(self.world.currentData())

    def show_status(self, status: EngineStatus) -> None:
        """Show the drum's state and the recording lamp."""
        name = status.state.name.replace("_", " ") if status.state is not None else "–"
        is_good = not status.fault and not status.is_left_in_contact
        self._show_state(name, _state_words(status), is_good=is_good)
        self.recording_display.show_status(status.run.state, status.recording)

    def _show_connection(self, button: str, *, connected: bool, locked: bool) -> None:
        super()._show_connection(button, connected=connected, locked=locked)
        self.world.setEnabled(not locked)
        self.world.setHidden(connected or self._joins)

    def _request_connection(self) -> None:
        self.connect_requested.emit(self.rig.currentData(), self.chosen_world)

    def add_page(self, page: QWidget) -> None:
        """Add what another experiment shows in the place of rig, state and recording."""
        self.pages.addWidget(page)

    def _lay_out(self) -> None:
        state = vbox(self.state, self.state_words)
        left = (self.rig, self.world, self.connect_button)
        row = hbox(*left, state, self.recording_display, wide=3, spacing=8)
        row.insertSpacing(3, 4)
        self.pages.addWidget(container(row))
        self.setLayout(hbox(self.pages, self.stop_button, wide=0, spacing=8, margins=(8, 5, 8, 5)))


_FAULT_WORDS = {"estop": "emergency stop", "loadcell": "load cell", "selftest": "self-test"}


def fault_name(fault: int) -> str:
    """Return the name of a fault; the strip and the panel have its sentence."""
    name = Fault(fault).name if fault in Fault._value2member_map_ else f"fault {fault}"
    words = (_FAULT_WORDS.get(word, word) for word in name.lower().split("_"))
    return " ".join(words)


def _state_words(status: EngineStatus) -> str:
    if status.is_left_in_contact:
        return STILL_IN_CONTACT
    if status.fault:
        return fault_name(status.fault)
    if not status.drum_connected:
        return "the drum board is not connected"
    return status.state_words
