"""Alarms: what is wrong and what to do, the strip that shows it, sound and desktop notice."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

from PySide6.QtCore import QObject, QTimer, Signal
from PySide6.QtWidgets import QApplication, QFrame, QStyle, QSystemTrayIcon

from gui.widgets.formatting import capitalised
from gui.widgets.labels import Level, StatusLamp, label
from gui.widgets.layouts import hbox, push_button
from rigctl.boards.drum_states import FAULT_TEXT, State
from rigctl.engine.rpc.messages import (
    DISCONNECTED_TEXT,
    FAULT,
    LINK,
    NOTHING_RECORDED_S,
    OPERATOR,
    EngineStatus,
    RunStatus,
    reason_words,
)

RELEASE_FIRST = "Release the emergency stop first"
CONTINUE = "Protocol → Continue a session … runs the remaining trials"


class Alarm(NamedTuple):
    """What is wrong, in a title and a text; ``command`` is what its button sends to the engine.

    ``blocked``: why the button is off, empty where it is on. ``key`` is the same while it is the
    same alarm. One that ``stays`` is over only when the user dismisses it.
    """

    key: str
    title: str
    text: str
    command: str = ""
    button: str = ""
    blocked: str = ""
    stays: bool = False


def status_alarms(status: EngineStatus) -> list[Alarm]:
    """Return the alarms of a status, the most important first.

    A drum that does not answer comes before its fault, which is an old value that nothing clears.
    """
    of_drum, links = (_fault(status), _contact(status)), _links(status)
    first = (*of_drum, links) if status.drum_connected else (links, *of_drum)
    return [alarm for alarm in (*first, _run_end(status)) if alarm is not None]


def run_end_words(status: EngineStatus) -> str:
    """Return how the run ended; of a fault that is cleared the cause, without what to do."""
    text = status.run.text
    is_over = not status.fault and text in FAULT_TEXT.values()
    return text.partition(":")[0] if is_over else text


def lost_engine(reason: str, last: EngineStatus) -> Alarm:
    """Return the alarm of an engine that has ended or is out of reach, after its last status."""
    if reason == DISCONNECTED_TEXT:
        return Alarm("lost", "CONNECTION LOST", f"{capitalised(reason)}.", stays=True)
    text = f"{capitalised(reason)}. {_how_to_go_on(last.run)}"
    return Alarm("lost", "ENGINE LOST", text, stays=True)


def silent_engine(last: EngineStatus) -> Alarm:
    """Return the alarm of an engine that does not answer, after its last status."""
    text = "The engine does not answer: press the emergency stop at the rig if the drum moves."
    session = f" It recorded {_session(last.run)}." if last.run.is_active else ""
    return Alarm("silent", "ENGINE SILENT", text + session)


def _fault(status: EngineStatus) -> Alarm | None:
    if not status.fault or status.is_stop_asked_for:
        return None
    contact = " The drum is still in contact with the sensor." if status.is_left_in_contact else ""
    words = f"{capitalised(status.fault_words)}.{contact}"
    session = f" Session: {_session(status.run)}." if status.run.is_active else ""
    can_clear = status.state is State.FAULT_OFF and not status.run.is_active
    button = ("clear_fault", "Clear fault") if can_clear else ("", "")
    blocked = RELEASE_FIRST if status.estop_pressed else ""
    return Alarm(f"fault {status.fault}", "FAULT", words + session, *button, blocked)


def _contact(status: EngineStatus) -> Alarm | None:
    if status.fault or not status.is_left_in_contact:
        return None
    text = "The drum is off and still in contact with the sensor. Lift it before anything else."
    button = ("", "") if status.run.is_active else ("arm", "Lift the drum")
    return Alarm("contact", "STILL IN CONTACT", text, *button)


def _links(status: EngineStatus) -> Alarm | None:
    boards = {"drum": status.drum_connected, "taxel": status.taxels_connected}
    lost = [name for name, connected in boards.items() if not connected]
    if not lost or not status.boards:
        return None
    text = f"No {' and no '.join(lost)} board answers: check its cable and its supply."
    session = f" The run of {_session(status.run)} waits for it." if status.run.is_active else ""
    return Alarm(f"link {lost}", "BOARD LOST", text + session)


def _run_end(status: EngineStatus) -> Alarm | None:
    run = status.run
    if run.state != "failed":
        return None
    text = f"{capitalised(run_end_words(status).rstrip('.'))}. {_how_to_go_on(run)}"
    return Alarm(f"run {run.session}", "RUN FAILED", text, stays=True)


def _how_to_go_on(run: RunStatus) -> str:
    if not run.session:
        return "Connect starts it again."
    connect = "" if run.state == "failed" else "Connect starts it again; "
    return f"{_session(run)} is kept. {connect}{CONTINUE}."


def _session(run: RunStatus) -> str:
    """Return a session's name, and how many of its trials are recorded."""
    name = Path(run.session).name if run.session else "no session"
    return f"{name} ({run.trials_committed} of {run.trials_planned} trials)"


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


REPEAT_MS = 4000
NOTICE_MS = 10_000
Notify = Callable[[str, str], None]


class Announcer(QObject):
    """Beeps until an alarm is over or silenced, and shows each new one on the desktop."""

    def __init__(
        self, beep: Callable[[], None] = QApplication.beep, notify: Notify | None = None
    ) -> None:
        super().__init__()
        self.sounds = True
        """Whether alarms beep."""
        self.notices = True
        """Whether the desktop shows them."""
        self._beep = beep
        self._notify = notify if notify is not None else DesktopNotice(self)
        self._repeat = QTimer(self)
        self._repeat.setInterval(REPEAT_MS)
        self._repeat.timeout.connect(self._sound)

    @property
    def is_sounding(self) -> bool:
        """Whether an alarm beeps again and again."""
        return self._repeat.isActive()

    def announce(self, title: str, text: str, *, repeats: bool) -> None:
        """Tell of something new; ``repeats`` goes on until :meth:`silence`."""
        self._sound()
        if self.notices:
            self._notify(title, text)
        if repeats:
            self._repeat.start()

    def silence(self) -> None:
        """Beep no more."""
        self._repeat.stop()

    def _sound(self) -> None:
        if self.sounds:
            self._beep()


class DesktopNotice(QObject):
    """A notice of the desktop through the system tray, where there is one."""

    def __init__(self, parent: QObject) -> None:
        super().__init__(parent)
        self._icon: QSystemTrayIcon | None = None

    def __call__(self, title: str, text: str) -> None:
        """Show a notice, and mark the window in the task bar."""
        for window in QApplication.topLevelWidgets():
            QApplication.alert(window)
        if not QSystemTrayIcon.isSystemTrayAvailable():
            return
        if self._icon is None:
            style = QApplication.style()
            icon = style.standardIcon(QStyle.StandardPixmap.SP_MessageBoxWarning)
            self._icon = QSystemTrayIcon(icon, self)
        self._icon.show()
        warning = QSystemTrayIcon.MessageIcon.Warning
        self._icon.showMessage(f"rigctl: {title}", text, warning, NOTICE_MS)


WAITS = "WAITS FOR YOU"


class AlarmCenter(QObject):
    """Shows the alarms of one engine in a strip, and announces each new one.

    Announces each question, too, and that a run is done, pauses by itself or records nothing.
    """

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
        self._recorded_s = 0.0
        self._news: tuple[str, str] | None = None

    def show_status(self, status: EngineStatus) -> None:
        """Show the alarms of a status, and announce its question and its run's news once."""
        self._announce_news(status)
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
        self._last, self._prompt_id, self._news = EngineStatus(), None, None
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

    def _announce_news(self, status: EngineStatus) -> None:
        before, self._news = self._news, self._news_of(status)
        if self._news not in (None, before):
            self.announcer.announce(*self._news, repeats=False)

    def _news_of(self, status: EngineStatus) -> tuple[str, str] | None:
        """Return what somebody should know of a run that is neither alarm nor question."""
        run = status.run
        is_new = not self._last.run.is_active
        if is_new or run.state != "running" or status.recording.active:
            self._recorded_s = status.at_s
        waits = reason_words(each for each in run.reasons if each not in (OPERATOR, LINK, FAULT))
        if run.state == "done" and (not is_new or self._news):
            return "The run is done", f"{capitalised(run.text)}. {_session(run)}."
        if run.state == "paused" and waits:
            return "The run is paused", f"{capitalised(waits)}. {_session(run)}."
        if status.at_s - self._recorded_s > NOTHING_RECORDED_S:
            text = f"For a minute {_session(run)} has got no samples: look at the rig."
            return "Nothing is recorded", text
        return None

    def _silence(self) -> None:
        self.announcer.silence()
        self._refresh()

    def _dismiss(self, key: str) -> None:
        self._kept.pop(key, None)
        self._dismissed.add(key)
        gone = {key, *self._kept}
        self._show([alarm for alarm in self._alarms if alarm.key not in gone])
