"""Engines that run already: announced, joined, shared, controlled by one window, and left."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from typing import Any, NamedTuple

import msgspec
from PySide6.QtCore import QDateTime, QEvent, QObject, Signal
from PySide6.QtWidgets import QPushButton, QWidget

from gui.link.engine_link import EngineChoice, EngineLink, name_this_window
from gui.widgets.background import Background
from gui.widgets.file_browser import ElidedComboBox
from gui.widgets.labels import Strip, label
from gui.widgets.layouts import container, hbox, push_button, vbox
from rigctl.engine.rpc.client import WINDOW, FoundEngine, client_name, find_engines
from rigctl.engine.rpc.engine_files import EngineFile
from rigctl.engine.rpc.messages import ControlState, EngineStatus

_Told = Callable[[list[FoundEngine]], None]
FindEngines = Callable[[], list[FoundEngine]]
CLOSE_TIMEOUT_S = 10.0
SHOWN_ENGINES = 8
"""More would not fit on a small screen; the newest are shown."""


class EnginesPage(QWidget):
    """Lists engines, each with *Join*; *Start another one* only where that is offered."""

    join_requested = Signal(EngineFile)
    start_requested = Signal()
    shown = Signal()
    closed = Signal()

    def __init__(self) -> None:
        super().__init__()
        self.join_buttons: list[QPushButton] = []
        self.text = label("", "heading", wraps=True)
        self.start_button = push_button("Start another one", self._start)
        self.dismiss_button = push_button("Not now", self.closed.emit)
        heading = hbox(self.text, self.start_button, self.dismiss_button, spacing=6)
        self._rows: list[QWidget] = []
        self._column = vbox(spacing=4)
        self.setLayout(
            vbox(
                container(heading),
                container(self._column),
                spacing=8,
                margins=(12, 10, 8, 8),
                tall=-1,
            )
        )

    def show_engines(self, text: str, engines: list[FoundEngine], *, may_start: bool) -> None:
        """Show a sentence and the engines to join."""
        self._clear()
        left_out = len(engines) - SHOWN_ENGINES
        more = f" {left_out} older ones are not shown." if left_out > 0 else ""
        self.text.setText(text + more)
        for engine in engines[:SHOWN_ENGINES]:
            self._add(engine)
        self.start_button.setVisible(may_start)
        self.shown.emit()

    def _clear(self) -> None:
        for row in self._rows:
            self._column.removeWidget(row)
            row.hide()
            row.deleteLater()
        self._rows, self.join_buttons = [], []

    def _add(self, found: FoundEngine) -> None:
        button = push_button("Join", partial(self._join, found.engine), f"Join {found.name}")
        button.setAccessibleName(f"Join {found.name}")
        words = label(f"{found.name}: {found.describe()}", wraps=True)
        row = container(hbox(words, button, spacing=6, margins=(0, 0, 0, 4)))
        self._rows.append(row)
        self.join_buttons.append(button)
        self._column.addWidget(row)

    def _join(self, engine: EngineFile) -> None:
        self.closed.emit()
        self.join_requested.emit(engine)

    def _start(self) -> None:
        self.closed.emit()
        self.start_requested.emit()


class SharedControl(QObject):
    """Follows the clients of the engine that a link is connected to."""

    changed = Signal()
    history_received = Signal(list)
    """The engine's events before the window joined, oldest first: age in s, kind and text."""

    def __init__(self, link: EngineLink[Any, Any]) -> None:
        super().__init__()
        self._link = link
        self.number = 0
        """This window among the clients, 0 before the engine has told."""
        self.state = ControlState()
        link.opened.connect(self._join)
        link.closed.connect(lambda _: self._reset())
        link.answered.connect(self._take_answer)
        link.event_received.connect(self._take_event)

    @property
    def has_control(self) -> bool:
        """Whether this window has control, or gets it with its next command."""
        return self.state.holder in (None, self.number)

    @property
    def asking(self) -> list[tuple[int, str]]:
        """Number and name of each client that asks for control."""
        return [(number, self.state.name_of(number)) for number in self.state.asking]

    @property
    def is_asking(self) -> bool:
        """Whether this window asks for control."""
        return self.number in self.state.asking

    def _join(self) -> None:
        self._reset()
        if self._link.has_joined:
            self._link.request("history")
        self._link.request("introduce", name=client_name(WINDOW))

    def _reset(self) -> None:
        self.number, self.state = 0, ControlState()
        self.changed.emit()

    def _take_answer(self, command: str, result: dict[str, Any]) -> None:
        """Take what the engine tells a window that joins."""
        if command == "introduce":
            self.number = result["client"]
            self._show(result["control"])
        elif command == "history":
            past = [(e["age_s"], e["kind"], name_this_window(e["text"])) for e in result["events"]]
            self.history_received.emit(past)

    def _take_event(self, message: dict[str, Any]) -> None:
        if message["event"] == "control":
            self._show(message["data"])

    def _show(self, data: dict[str, Any]) -> None:
        self.state = msgspec.convert(data, ControlState)
        self.changed.emit()


class ControlStrip(Strip):
    """Says who has control; asks for it, takes it or gives it."""

    command_requested = Signal(str, dict)

    def __init__(self, sharing: SharedControl) -> None:
        super().__init__()
        self._sharing = sharing
        self._asking = 0
        self.ask = push_button("Ask for control", lambda: self._send("ask_control"))
        self.take = push_button("Take control", lambda: self._send("take_control"))
        self.give = push_button("Give control", self._give)
        self.lay_out(self.ask, self.take, self.give)
        sharing.changed.connect(self._show)

    def _show(self) -> None:
        """Show who has control, or hide where this window has it and nobody asks."""
        sharing = self._sharing
        asking = sharing.asking if sharing.has_control else []
        watches = bool(sharing.number) and not sharing.has_control
        for button in (self.ask, self.take):
            button.setVisible(watches)
        self.give.setVisible(bool(asking))
        self.ask.setEnabled(not sharing.is_asking)
        if asking:
            self._asking, name = asking[0]
            self.text.setText(f"{name} asks for control.")
        elif watches:
            asked = " You have asked for it." if sharing.is_asking else ""
            self.text.setText(
                f"You watch: {sharing.state.holder_name} has control.{asked} STOP works from here."
            )
        self.setVisible(bool(asking) or watches)

    def _give(self) -> None:
        self.command_requested.emit("give_control", {"to": self._asking})

    def _send(self, command: str) -> None:
        self.command_requested.emit(command, {})


class ControlLock(QObject):
    """Keeps controls off, with the reason as tooltip, while another client has control.

    A control that its panel enables meanwhile stays off. STOP is never among the controls.
    """

    released = Signal()
    """This window has control again; each panel shows what is possible now."""

    def __init__(self, shared: SharedControl, controls: Iterable[QWidget]) -> None:
        super().__init__()
        self._shared, self._controls = shared, tuple(controls)
        self._reason = ""
        self._tooltips: dict[QWidget, str] = {}
        for control in self._controls:
            control.installEventFilter(self)
        shared.changed.connect(self._follow)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Keep a control off that its panel changes."""
        kinds = (QEvent.Type.EnabledChange, QEvent.Type.ToolTipChange)
        if self._reason and event.type() in kinds and isinstance(watched, QWidget):
            self._lock(watched)
        return False

    def _follow(self) -> None:
        before, now = self._reason, _reason(self._shared)
        if now == before:
            return
        self._reason = ""
        self._restore()
        self._reason = now
        for control in self._controls if now else ():
            self._lock(control)
        if not now:
            self.released.emit()

    def _lock(self, control: QWidget) -> None:
        if self._reason not in control.toolTip():
            self._tooltips[control] = control.toolTip()
            whole = control.currentText() if isinstance(control, ElidedComboBox) else ""
            control.setToolTip("\n".join(filter(None, (whole, self._reason))))
        control.setEnabled(False)

    def _restore(self) -> None:
        tooltips, self._tooltips = self._tooltips, {}
        for control, tooltip in tooltips.items():
            control.setToolTip(tooltip)
            control.setEnabled(True)


def _reason(shared: SharedControl) -> str:
    """Return why this window cannot act on the rig; empty where it can."""
    if not shared.number or shared.has_control:
        return ""
    return f"{shared.state.holder_name} has control: ask for it, or take it, at the top"


HISTORY_EVENTS_SHOWN = 200


class PastLine(NamedTuple):
    """A line of the log from before the window joined: when it was, its kind and its text."""

    at: QDateTime
    kind: str
    text: str


class ClosingStrip(Strip):
    """Asks what becomes of a run when its window closes."""

    close_requested = Signal()
    """The window closes, and the run goes on."""
    stop_requested = Signal()
    """The run ends safely first."""

    def __init__(self) -> None:
        super().__init__()
        self.leave = push_button("Close, the run goes on", self.close_requested.emit)
        self.stop = push_button("End the run and close", self.stop_requested.emit)
        self.stay = push_button("Stay", self.hide)
        self.lay_out(self.leave, self.stop, self.stay)

    def ask(self, session: str, queued: int = 0) -> None:
        """Ask about the run into a session, and tell how many runs wait behind it."""
        then = f", and so does its queue of {queued}" if queued else ""
        self.text.setText(
            f"A protocol runs into {session}. It goes on without this window{then}: open the "
            "window again to join it."
        )
        self.stop.setEnabled(True)
        self.show()
        self.leave.setFocus()

    def show_stopping(self) -> None:
        """Show that the run ends and that the window then closes."""
        self.text.setText("The run ends safely; the window closes when its session is written.")
        self.stop.setEnabled(False)


class AttachController(QObject):
    """Finds engines, asks what to do with them, and follows who has control of each link's."""

    join_requested = Signal(EngineFile)
    """Join the engine, in the place of its experiment."""
    start_requested = Signal()
    """Start another engine on the drum's rig that was to open."""
    start_finger_requested = Signal()
    """The same for the moving finger."""
    reported = Signal(str, str)
    """Kind and text for the event log."""
    close_confirmed = Signal()
    """The window may close, and a run goes on."""
    history_received = Signal(list)
    """A :class:`PastLine` for each event from before the window joined."""

    def __init__(
        self, links: tuple[EngineLink[Any, Any], ...], find: FindEngines = find_engines
    ) -> None:
        super().__init__()
        self._links = links
        self._find, self._background = find, Background("rigctl-engine-finder")
        self._told: _Told | None = None
        self.engines, self.closing = EnginesPage(), ClosingStrip()
        self.shared = tuple(map(SharedControl, links))
        self.controls = tuple(map(ControlStrip, self.shared))
        self._may_close = self._ends_run = False
        self._chosen_for = links[0]
        for link, shared, control in zip(links, self.shared, self.controls, strict=True):
            self._connect(link, shared, control)
        self.engines.join_requested.connect(self.join_requested)
        self.engines.start_requested.connect(self._start)
        self.closing.close_requested.connect(self._confirm)
        self.closing.stop_requested.connect(self._end_run)

    @property
    def strips(self) -> tuple[QWidget, ...]:
        """The strips, in their order from the top."""
        return (self.closing, *self.controls)

    def announce(self) -> None:
        """Look for running engines; if there are any, say so and offer to join them."""
        self._search(self._announce)

    def list_engines(self) -> None:
        """List the running engines; say so where there are none."""
        self._search(self._list)

    def leave(self) -> None:
        """Close the window without a question; a run goes on."""
        self._confirm()

    def may_close(self) -> bool:
        """Return whether the window may close now; else ask what becomes of the run."""
        running = [link for link in self._links if link.status.run.is_active]
        if self._may_close or not running:
            return True
        status = running[0].status
        queued = len(status.queue.entries) if isinstance(status, EngineStatus) else 0
        self.closing.ask(str(status.run.session or "its session"), queued)
        return False

    def close(self) -> None:
        """Forget a search and wait for its end."""
        self._background.close(CLOSE_TIMEOUT_S)

    def _connect(
        self, link: EngineLink[Any, Any], shared: SharedControl, control: ControlStrip
    ) -> None:
        control.command_requested.connect(lambda command, args: link.request(command, **args))
        shared.history_received.connect(self._show_history)
        link.opened.connect(self.engines.closed)
        link.choice_needed.connect(partial(self._choose, link))
        link.status_changed.connect(lambda _: self._follow_run())
        link.closed.connect(lambda _: self._follow_run())

    def _search(self, told: _Told) -> None:
        """Ask all engines what they do; the later of two questions gets the answer to both."""
        if self._told is None:
            self._background.run(self._find, self._tell, lambda _: self._tell([]))
        self._told = told

    def _tell(self, found: list[FoundEngine]) -> None:
        told, self._told = self._told, None
        if told is not None:
            told(found)

    def _announce(self, found: list[FoundEngine]) -> None:
        if found and not any(link.is_connected for link in self._links):
            running = "1 engine runs" if len(found) == 1 else f"{len(found)} engines run"
            self.engines.show_engines(f"{running} already.", found, may_start=False)

    def _list(self, found: list[FoundEngine]) -> None:
        if found:
            self.engines.show_engines("Running engines:", found, may_start=False)
        else:
            self.reported.emit("rig", "no engine is running: choose a rig and press Connect")

    def _start(self) -> None:
        is_drum = self._chosen_for is self._links[0]
        (self.start_requested if is_drum else self.start_finger_requested).emit()

    def _choose(self, link: EngineLink[Any, Any], choice: EngineChoice) -> None:
        self._chosen_for = link
        self.engines.show_engines(str(choice), choice.engines, may_start=choice.may_start)

    def _show_history(self, events: list[tuple[float, str, str]]) -> None:
        now = QDateTime.currentDateTime()
        shown = events[-HISTORY_EVENTS_SHOWN:]
        lines = [
            PastLine(now.addMSecs(-round(1000 * age)), kind, text) for age, kind, text in shown
        ]
        self.history_received.emit(lines)

    def _end_run(self) -> None:
        self._ends_run = True
        self.closing.show_stopping()
        for link in self._links:
            if link.status.run.is_active:
                link.request("abort")

    def _follow_run(self) -> None:
        """Close once the run has ended that was to end first; ask no more without a run."""
        if any(link.status.run.is_active for link in self._links):
            return
        self.closing.hide()
        if self._ends_run:
            self._ends_run = False
            self._confirm()

    def _confirm(self) -> None:
        self._may_close = True
        self.close_confirmed.emit()
