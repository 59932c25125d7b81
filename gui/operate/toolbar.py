"""The top bar: which rig, connected or not, its state in words, recording truth, STOP."""

from __future__ import annotations

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import (
    QFrame,
    QHBoxLayout,
    QPushButton,
    QSizePolicy,
    QVBoxLayout,
    QWidget,
)

from gui.engine_link import JOIN
from gui.operate.rig_choice import FileChoice
from gui.widgets.formatting import fault_sentence
from gui.widgets.labels import elastic, label, set_property, show_text
from gui.widgets.status_lamp import Level, StatusLamp
from gui.widgets.theme import Theme
from rigctl.acquisition.rpc.messages import EngineStatus, RecordingStatus

RIGS = (
    ("Virtual rig", "virtual"),
    ("Firmware on simulated chips", "firmware"),
    ("Join the running engine", JOIN),
)
WORLDS = (("Nominal world", ""),)
UNRECORDED_LIMIT = 12  # statuses, ten a second: the engine judges by the last second itself


class Toolbar(QFrame):
    """Emits what was asked for; knows no engine."""

    connect_asked = Signal(str, str)
    disconnect_asked = Signal()
    stop_asked = Signal()

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self.rig = FileChoice(RIGS, "open a rig.toml …", 205)
        self.rig.setToolTip("Which rig to connect to")
        self.world = FileChoice(WORLDS, "open a world file …", 145)
        self.world.setToolTip("Plates, sensor and mechanics of a simulated rig")
        self.rig.currentIndexChanged.connect(lambda _: self._offer_world())
        self.connect_button = QPushButton("Connect")
        self.connect_button.setMinimumWidth(104)
        self.connect_button.clicked.connect(self._connect_clicked)
        self.state, self.words = label("–", "state"), elastic(label("not connected", "muted"))
        self.lamp = StatusLamp(theme, 18)
        self.recording, self.samples = label("Not recording", "heading"), label("", "muted")
        self.stop = QPushButton("STOP")
        self.stop.setObjectName("stop")
        self.stop.setMinimumSize(150, 46)
        self.stop.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self.stop.setToolTip("Stop the drum and lift it, from any state (Esc)")
        self.stop.pressed.connect(self.stop_asked)
        self._connected = False
        self._unrecorded = 0
        self._lay_out()

    def set_theme(self, theme: Theme) -> None:
        """Shine in other colours."""
        self.lamp.set_theme(theme)

    def show_connecting(self, spec: str) -> None:
        """The engine is starting."""
        self._connected = False
        self.connect_button.setText("Connecting …")
        self.connect_button.setEnabled(False)
        self._lock(True)
        show_text(self.words, f"starting the engine for {spec} …")

    def show_disconnected(self, words: str = "not connected") -> None:
        """No engine."""
        self._connected = False
        self.connect_button.setText("Connect")
        self.connect_button.setEnabled(True)
        self._lock(False)
        self.state.setText("–")
        set_property(self.state, "level", "ok")
        show_text(self.words, words)
        self._show_recording(Level.OFF, "Not recording", "")

    def show_connected(self) -> None:
        """The engine answers."""
        self._connected = True
        self.connect_button.setText("Disconnect")
        self.connect_button.setEnabled(True)
        self._lock(True)

    def show_silent(self, seconds: float) -> None:
        """The engine said nothing for a while: what was shown is no longer true."""
        self.state.setText("?")
        set_property(self.state, "level", "bad")
        show_text(self.words, f"the engine has not answered for {seconds:.0f} s")
        self._show_recording(Level.BAD, "Recording: unknown", "the engine does not answer")

    def show_status(self, status: EngineStatus) -> None:
        """State and recording light of a fresh status."""
        name = status.state.name.replace("_", " ") if status.state is not None else "–"
        self.state.setText(name)
        set_property(self.state, "level", "bad" if status.fault else "ok")
        show_text(self.words, _state_words(status))
        missing = status.run.state == "running" and not status.recording.active
        self._unrecorded = self._unrecorded + 1 if missing else 0
        self._show_recording(*recording_truth(status.recording, self._unrecorded))

    def _lock(self, locked: bool) -> None:
        self.rig.setEnabled(not locked)
        self.world.setEnabled(not locked)

    def _offer_world(self) -> None:
        """An engine that is joined has its world already."""
        self.world.setVisible(self.rig.currentData() != JOIN)

    def _connect_clicked(self) -> None:
        if self._connected:
            self.disconnect_asked.emit()
        else:
            world = "" if self.rig.currentData() == JOIN else self.world.currentData()
            self.connect_asked.emit(self.rig.currentData(), world)

    def _show_recording(self, level: Level, title: str, detail: str) -> None:
        self.lamp.set_level(level)
        show_text(self.recording, title)
        show_text(self.samples, detail)
        set_property(self.recording, "role", "bad" if level is Level.BAD else "heading")

    def _lay_out(self) -> None:
        row = QHBoxLayout(self)
        row.setContentsMargins(8, 5, 8, 5)
        row.setSpacing(8)
        row.addWidget(self.rig)
        row.addWidget(self.world)
        row.addWidget(self.connect_button)
        row.addSpacing(10)
        row.addLayout(_two_lines(self.state, self.words), 1)
        row.addWidget(self.lamp)
        record = QWidget()
        record.setFixedWidth(230)
        record.setSizePolicy(QSizePolicy.Policy.Fixed, QSizePolicy.Policy.Preferred)
        lines = _two_lines(self.recording, self.samples)
        lines.setContentsMargins(0, 0, 0, 0)
        record.setLayout(lines)
        row.addWidget(record)
        row.addWidget(self.stop)


def recording_truth(recording: RecordingStatus, unrecorded: int) -> tuple[Level, str, str]:
    """Level, title and detail of the light; only samples that reached the disk make it green.

    ``unrecorded``: how many statuses in a row told of a running protocol and an idle disk.
    """
    if recording.failure:
        return Level.BAD, "NOT RECORDING", recording.failure
    if recording.active:
        total = f"{recording.samples_on_disk:,} samples".replace(",", "\u202f")
        return Level.OK, "Recording", f"{total}, {recording.samples_last_s}/s to disk"
    if unrecorded > UNRECORDED_LIMIT:
        return Level.BAD, "NOT RECORDING", "a run is going, but nothing reaches the disk"
    return Level.OFF, "Not recording", "no trials are being run"


def _state_words(status: EngineStatus) -> str:
    if status.fault:
        return status.fault_words or fault_sentence(status.fault)
    if not status.drum_connected:
        return "the drum's board is not connected"
    return status.state_words


def _two_lines(upper: QWidget, lower: QWidget) -> QVBoxLayout:
    lines = QVBoxLayout()
    lines.setSpacing(0)
    lines.addWidget(upper)
    lines.addWidget(lower)
    return lines
