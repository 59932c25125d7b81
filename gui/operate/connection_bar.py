"""The toolbar: choice of the rig, connection, drum state, recording lamp and STOP."""

from __future__ import annotations

from textwrap import shorten

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QFrame, QStackedWidget, QWidget

from gui.link.engine_link import JOIN, NOT_CONNECTED
from gui.widgets.data_ages import DataAges, stale_words
from gui.widgets.file_browser import FileComboBox, PathKind
from gui.widgets.formatting import grouped
from gui.widgets.labels import (
    Level,
    StatusLamp,
    StopButton,
    elastic,
    label,
    plain_tooltip,
    set_property,
    show_text,
)
from gui.widgets.layouts import container, hbox, push_button, vbox
from rigctl.boards.drum_states import Fault
from rigctl.engine.rpc.engine_files import EngineFile
from rigctl.engine.rpc.messages import EngineStatus, RecordingStatus

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


REASON_LETTERS = 60
"""A longer reason made the heading higher than the plots on a small screen."""


class ConnectionBar(QFrame):
    """Emits signals only; it does not know the engine. A subclass lays the widgets out."""

    connect_clicked = Signal()
    """A subclass turns it into the request for the chosen rig."""
    disconnect_requested = Signal()

    def __init__(self, rig: FileComboBox) -> None:
        super().__init__()
        self.setProperty("role", "heading")
        self.rig = rig
        self.connect_button = push_button("Connect", self._toggle_connection)
        self.connect_button.setMinimumWidth(104)
        self.state, self.state_words = (
            label("–", "state"),
            elastic(label(NOT_CONNECTED, "muted", wraps=True)),
        )
        self.recording_display = RecordingDisplay()
        self._is_connected = self._is_connecting = False
        self._level, self._words = "ok", NOT_CONNECTED

    def show_connecting(self) -> None:
        """Show that the chosen rig's engine is starting."""
        self._show_connection("Cancel", connected=False, locked=True)
        self._is_connecting = True
        self.state_words.setToolTip("")  # why the connection before ended
        self.show_opening(0.0)

    def show_opening(self, seconds: float) -> None:
        """Show for how long the window has tried to connect."""
        starting = f"starting the engine for {self.rig.currentText()}"
        what = "joining the running engine" if self._joins else starting
        show_text(self.state_words, f"{what} … {seconds:.0f} s")

    def show_connected(self) -> None:
        """Show that the engine answers."""
        self._show_connection("Disconnect", connected=True, locked=True)

    def show_disconnected(self, reason: str) -> None:
        """Show that there is no engine, and why; the tooltip has all of a long reason."""
        self._show_connection("Connect", connected=False, locked=False)
        self.state.setText("–")
        set_property(self.state, "level", "ok")
        show_text(self.state_words, _short_reason(reason))
        self.state_words.setToolTip(plain_tooltip(reason))
        self.recording_display.show_recording(Level.OFF, "Not recording", "")

    def offer_again(self, engine: EngineFile) -> None:
        """Choose the rig of an engine that was joined and is lost: Connect starts it again."""
        if self._joins:
            self.rig.choose(engine.rig)

    def show_silent(self, seconds: float) -> None:
        """Show that the last status is out of date: the engine does not answer."""
        self.state.setText("?")
        set_property(self.state, "level", "bad")
        show_text(self.state_words, f"the engine has not answered for {seconds:.0f} s")
        self.recording_display.show_silent()

    def show_alarm(self, *, is_on: bool) -> None:
        """Colour the heading while there is an alarm."""
        set_property(self, "alarm", "on" if is_on else "off")

    def show_ages(self, ages: DataAges) -> None:
        """Turn a state that is no longer live grey, with its age."""
        age_s = max((s for s in (ages.engine_s, ages.drum_s) if s is not None), default=None)
        words = stale_words(age_s)
        set_property(self.state, "level", "stale" if words else self._level)
        show_text(self.state_words, words or self._words)

    @property
    def _joins(self) -> bool:
        return bool(self.rig.currentData() == JOIN)

    def _show_state(self, name: str, words: str, *, is_good: bool) -> None:
        self._level, self._words = "ok" if is_good else "bad", words
        self.state.setText(name)
        set_property(self.state, "level", self._level)
        show_text(self.state_words, words)

    def _show_connection(self, button: str, *, connected: bool, locked: bool) -> None:
        self._is_connected, self._is_connecting = connected, False
        self.connect_button.setText(button)
        self.connect_button.setEnabled(True)
        self.rig.setEnabled(not locked)

    def _toggle_connection(self) -> None:
        if self._is_connected or self._is_connecting:
            self.disconnect_requested.emit()
        else:
            self.connect_clicked.emit()


def _short_reason(reason: str) -> str:
    """Return a reason, of a long one its cause, or its beginning if only a board stands first."""
    if len(reason) <= REASON_LETTERS:
        return reason
    cause = reason.partition(":")[0].partition(" (")[0]
    return cause if " " in cause else shorten(reason, REASON_LETTERS, placeholder=" …")


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
        has_fault = bool(status.fault) and not status.is_stop_asked_for
        is_good = not has_fault and not status.is_left_in_contact
        self._show_state(name, _state_words(status), is_good=is_good)
        self.recording_display.show_status(status.run.state, status.recording)

    def _show_connection(self, button: str, *, connected: bool, locked: bool) -> None:
        super()._show_connection(button, connected=connected, locked=locked)
        self.world.setEnabled(not locked)
        self.world.setHidden(connected or self._joins)

    def _request_connection(self) -> None:
        self.connect_requested.emit(self.rig.currentData(), self.chosen_world)

    def offer_again(self, engine: EngineFile) -> None:
        """Choose the rig of a joined engine that is lost, and its world."""
        if self._joins:
            self.world.choose(engine.world)
        super().offer_again(engine)

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
