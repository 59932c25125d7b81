"""Which alarms there are, which are new, and which the user has taken note of."""

from __future__ import annotations

from PySide6.QtCore import QObject, Signal

from gui.alarm.alarm_strip import AlarmStrip
from gui.alarm.alarms import Alarm, lost_engine, silent_engine, status_alarms
from gui.alarm.announcer import Announcer
from rigctl.acquisition.rpc.messages import EngineStatus

WAITS = "WAITS FOR YOU"


class AlarmCenter(QObject):
    """Shows the alarms of one engine in a strip, and announces each new one and each question."""

    title_changed = Signal(str)
    """Title of the first alarm, empty without one: for the window's title and its heading."""

    def __init__(self, announcer: Announcer | None = None) -> None:
        super().__init__()
        self.announcer = announcer if announcer is not None else Announcer()
        self.strip = AlarmStrip()
        self.strip.silenced.connect(self._silence)
        self.strip.dismissed.connect(self._dismiss)
        self._last = EngineStatus()
        self._alarms: list[Alarm] = []
        self._kept: dict[str, Alarm] = {}
        self._dismissed: set[str] = set()
        self._prompt_id: int | None = None

    def show_status(self, status: EngineStatus) -> None:
        """Show the alarms of a status, and announce its question if it is a new one."""
        self._last = status
        present = status_alarms(status)
        self._dismissed &= {alarm.key for alarm in present}
        self._announce_prompt(status)
        self._show([alarm for alarm in present if alarm.key not in self._dismissed])

    def show_lost(self, reason: str) -> None:
        """Show that the engine has ended; the alarm stays until the next connection."""
        alarm = lost_engine(reason, self._last)
        self._kept[alarm.key] = alarm
        self._show([])

    def show_silent(self) -> None:
        """Show that the engine does not answer, until its next status."""
        self._show([silent_engine(self._last)])

    def forget(self) -> None:
        """Forget the alarms of the last engine: another one is connected, or the user left it."""
        self._last, self._prompt_id = EngineStatus(), None
        self._kept.clear()
        self._dismissed.clear()
        self._show([])

    def _show(self, present: list[Alarm]) -> None:
        alarms = [*self._kept.values(), *present]
        known = {alarm.key for alarm in self._alarms}
        self._alarms = alarms
        for alarm in alarms:
            if alarm.key not in known:
                self.announcer.announce(alarm.title, alarm.text, repeats=True)
        if not alarms:
            self.announcer.silence()
        self._refresh()

    def _refresh(self) -> None:
        self.strip.show_alarms(self._alarms, sounds=self.announcer.is_sounding)
        question = WAITS if self._prompt_id is not None else ""
        self.title_changed.emit(self._alarms[0].title if self._alarms else question)

    def _announce_prompt(self, status: EngineStatus) -> None:
        prompt = status.run.prompt
        if prompt is not None and prompt.id != self._prompt_id:
            self.announcer.announce("The run waits for you", prompt.text, repeats=False)
        self._prompt_id = prompt.id if prompt is not None else None

    def _silence(self) -> None:
        self.announcer.silence()
        self._refresh()

    def _dismiss(self, key: str) -> None:
        self._kept.pop(key, None)
        self._dismissed.add(key)
        gone = {key, *self._kept}
        self._show([alarm for alarm in self._alarms if alarm.key not in gone])
