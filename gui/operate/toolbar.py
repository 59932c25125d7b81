"""The toolbar: choice of the rig, connection, drum state, recording lamp and STOP."""

from __future__ import annotations

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QComboBox, QFrame, QPushButton

from gui.engine_link import JOIN, NOT_CONNECTED
from gui.widgets.file_browser import PathKind
from gui.widgets.labels import elastic, label, set_property, show_text
from gui.widgets.layouts import container, hbox, push_button, vbox
from gui.widgets.status_lamp import Level, StatusLamp
from rigctl.acquisition.rpc.messages import EngineStatus, RecordingStatus

RIGS = {
    "Virtual rig": "virtual",
    "Firmware on simulated chips": "firmware",
    "Join the running engine": JOIN,
}
WORLDS = {"Nominal world": ""}
UNRECORDED_LIMIT = 12  # statuses, ten a second: longer than the second that the engine judges


class FileComboBox(QComboBox):
    """A list of named items that also takes files; its last item opens the file browser."""

    path_requested = Signal(object, object)

    def __init__(self, items: dict[str, str], kind: PathKind, browse: str, width_px: int) -> None:
        super().__init__()
        for text, data in items.items():
            self.addItem(text, data)
        self.addItem(browse, None)
        self._kind = kind
        # A long file name is cut off; it must not push STOP out of the window.
        self.setSizeAdjustPolicy(self.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon)
        self.setMinimumWidth(width_px)
        self.activated.connect(self._browse)

    def choose(self, data: str) -> None:
        """Choose the item with this data; add a file that is not in the list yet."""
        if (index := self.findData(data)) < 0:
            index = self.count() - 1
            self.insertItem(index, data.rsplit("/", 1)[-1], data)
            self.setItemData(index, data, Qt.ItemDataRole.ToolTipRole)
        self.setCurrentIndex(index)

    def _browse(self, index: int) -> None:
        if self.itemData(index) is None:
            self.setCurrentIndex(0)
            self.path_requested.emit(self._kind, self.choose)


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
        self.recording_lamp = StatusLamp(18)
        self.recording, self.samples = label("Not recording", "heading"), label("", "muted")
        self.stop_button = QPushButton("STOP")
        self.stop_button.setObjectName("stop")
        self.stop_button.setMinimumSize(150, 46)
        self.stop_button.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self.stop_button.setToolTip("Stop and lift the drum, from any state (Esc)")
        self.stop_button.pressed.connect(self.stop_requested)
        self._is_connected = False
        self._unrecorded = 0
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
        self._show_recording(Level.OFF, "Not recording", "")

    def show_silent(self, seconds: float) -> None:
        """Show that the last status is out of date: the engine does not answer."""
        self.state.setText("?")
        set_property(self.state, "level", "bad")
        show_text(self.state_words, f"the engine has not answered for {seconds:.0f} s")
        self._show_recording(Level.BAD, "Recording: unknown", "the engine does not answer")

    def show_status(self, status: EngineStatus) -> None:
        """Show the drum's state and the recording lamp."""
        name = status.state.name.replace("_", " ") if status.state is not None else "–"
        self.state.setText(name)
        set_property(self.state, "level", "bad" if status.fault else "ok")
        show_text(self.state_words, _state_words(status))
        is_missing = status.run.state == "running" and not status.recording.active
        self._unrecorded = self._unrecorded + 1 if is_missing else 0
        self._show_recording(*judge_recording(status.recording, self._unrecorded))

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

    def _show_recording(self, level: Level, title: str, detail: str) -> None:
        self.recording_lamp.set_level(level)
        show_text(self.recording, title)
        show_text(self.samples, detail)
        set_property(self.recording, "role", "bad" if level is Level.BAD else "heading")

    def _lay_out(self) -> None:
        state = vbox(self.state, self.state_words)
        recording = container(vbox(self.recording, self.samples))
        recording.setFixedWidth(230)
        left = (self.rig, self.world, self.connect_button)
        right = (self.recording_lamp, recording, self.stop_button)
        row = hbox(*left, state, *right, wide=3, spacing=8, margins=(8, 5, 8, 5))
        row.insertSpacing(3, 10)
        self.setLayout(row)


def judge_recording(recording: RecordingStatus, unrecorded: int) -> tuple[Level, str, str]:
    """Return the lamp's level, title and detail; only samples on the disk make it green.

    ``unrecorded`` counts the successive statuses of a running protocol without a recording.
    """
    if recording.failure:
        return Level.BAD, "NOT RECORDING", recording.failure
    if recording.active:
        total = f"{recording.samples_on_disk:,} samples".replace(",", "\u202f")
        return Level.OK, "Recording", f"{total}, {recording.samples_last_s}/s to disk"
    if unrecorded > UNRECORDED_LIMIT:
        return Level.BAD, "NOT RECORDING", "a protocol is running, but no samples reach the disk"
    return Level.OFF, "Not recording", "no trials are running"


def _state_words(status: EngineStatus) -> str:
    if status.fault:
        return status.fault_words
    if not status.drum_connected:
        return "the drum board is not connected"
    return status.state_words
