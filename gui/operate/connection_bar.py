"""Choice of a rig, its connection, a state in words, and the recording lamp."""

from __future__ import annotations

from textwrap import shorten

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QFrame

from gui.link.engine_clients import JOIN
from gui.link.engine_link import NOT_CONNECTED
from gui.operate.recording_display import RecordingDisplay
from gui.widgets.data_ages import DataAges, stale_words
from gui.widgets.file_combo_box import FileComboBox
from gui.widgets.labels import elastic, label, plain_tooltip, set_property, show_text
from gui.widgets.layouts import push_button
from gui.widgets.status_lamp import Level

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
