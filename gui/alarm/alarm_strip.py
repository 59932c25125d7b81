"""The strip of the most important alarm: what it is, what to do, and a button that does it."""

from __future__ import annotations

from collections.abc import Sequence

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QFrame

from gui.alarm.alarms import Alarm
from gui.widgets.labels import label
from gui.widgets.layouts import hbox, push_button
from gui.widgets.status_lamp import Level, StatusLamp


class AlarmStrip(QFrame):
    """Title, text and buttons of the first of the present alarms; hidden without one."""

    command_requested = Signal(str, dict)
    silenced = Signal()
    dismissed = Signal(str)
    """Key of the alarm that the user has taken note of."""

    def __init__(self) -> None:
        super().__init__()
        self.setProperty("role", "alarm")
        self._alarm: Alarm | None = None
        lamp = StatusLamp(22)
        lamp.set_level(Level.BAD)
        self.title, self.text = label("", "alarm"), label("", wraps=True)
        self.act = push_button("", self._act)
        self.silence = push_button("Silence", self.silenced.emit, "Stop the sound of this alarm")
        self.dismiss = push_button("Dismiss", self._dismiss, "Hide this strip; the log keeps it")
        buttons = (self.act, self.silence, self.dismiss)
        row = hbox(lamp, self.title, self.text, *buttons, wide=2, spacing=8)
        row.setContentsMargins(10, 2, 10, 2)
        self.setLayout(row)
        self.hide()

    def show_alarms(self, alarms: Sequence[Alarm], *, sounds: bool) -> None:
        """Show the first alarm and how many others there are; ``sounds``: it can be silenced."""
        alarm = alarms[0] if alarms else None
        self.silence.setVisible(sounds)
        if alarm is not None:
            self._show(alarm, len(alarms) - 1)
        self._alarm = alarm
        self.setVisible(alarm is not None)

    def _show(self, alarm: Alarm, n_others: int) -> None:
        others = f" (and {n_others} more)" if n_others else ""
        self.title.setText(alarm.title + others)
        self.text.setText(alarm.text)
        self.act.setText(alarm.button)
        self.act.setVisible(bool(alarm.command))
        self.act.setEnabled(not alarm.blocked)
        self.act.setToolTip(alarm.blocked)
        self.dismiss.setVisible(alarm.stays)

    def _act(self) -> None:
        if self._alarm is not None:
            self.command_requested.emit(self._alarm.command, {})

    def _dismiss(self) -> None:
        if self._alarm is not None:
            self.dismissed.emit(self._alarm.key)
