"""What must not be overlooked on the drum rig: alarms, and values that are no longer live."""

from __future__ import annotations

from typing import Protocol

from PySide6.QtCore import QElapsedTimer, QObject, Signal

from gui.alarm.alarm_center import AlarmCenter
from gui.link.engine_link import NOT_CONNECTED
from gui.widgets.data_ages import DataAges, data_ages
from rigctl.acquisition.rpc.messages import EngineStatus


class AgeView(Protocol):
    """A view that turns grey what is no longer live."""

    def show_ages(self, ages: DataAges) -> None:
        """Show how old the newest data are."""


class DrumSafety(QObject):
    """Follows one engine: passes the ages of its data to the views, and its alarms to the strip.

    After a loss the ages of the last data go on growing, so that nothing old looks live.
    ``connected_views`` show nothing without an engine, ``other_views`` keep the last data.
    """

    title_changed = Signal(str)
    """Title of the first alarm, empty without one."""

    def __init__(
        self, connected_views: tuple[AgeView, ...], other_views: tuple[AgeView, ...]
    ) -> None:
        super().__init__()
        self.alarms = AlarmCenter()
        self.alarms.title_changed.connect(self.title_changed)
        self._connected_views, self._other_views = connected_views, other_views
        self._is_connected = False
        self._status = EngineStatus()
        self._since_status = QElapsedTimer()

    def show_status(self, status: EngineStatus) -> None:
        """Take a status that came now."""
        self._status = status
        self._since_status.start()
        self._is_connected = True
        self.alarms.show_status(status)
        self.poll()

    def show_opened(self) -> None:
        """Forget the last engine: another one is connected."""
        self._status = EngineStatus()
        self._since_status.invalidate()
        self.alarms.forget()
        for view in (*self._connected_views, *self._other_views):
            view.show_ages(DataAges())

    def show_closed(self, reason: str) -> None:
        """Raise the alarm unless the user has disconnected or no engine was there."""
        was_connected, self._is_connected = self._is_connected, False
        if reason == NOT_CONNECTED:
            self.alarms.forget()
        elif was_connected:
            self.alarms.show_lost(reason)

    def poll(self) -> None:
        """Let the ages grow; the window's timer calls this."""
        if not self._since_status.isValid():
            return
        ages = data_ages(self._status, self._since_status.elapsed() / 1000)
        for view in self._other_views:
            view.show_ages(ages)
        if self._is_connected:
            for view in self._connected_views:
                view.show_ages(ages)
