"""Engines that run already, in the window: announced, joined, shared and left."""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

from PySide6.QtCore import QDateTime, QObject, Signal
from PySide6.QtWidgets import QWidget

from gui.link.control import ControlStrip, SharedControl
from gui.link.engine_clients import EngineChoice
from gui.link.engine_link import EngineLink
from gui.link.engines import EngineFinder, EnginesPage, FindEngines
from gui.widgets.layouts import push_button
from gui.widgets.strip import Strip
from rigctl.acquisition.rpc.client import FoundEngine, find_engines
from rigctl.acquisition.rpc.engine_files import EngineFile

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
        self.setLayout(self.row(self.leave, self.stop, self.stay))

    def ask(self, session: str) -> None:
        """Ask about the run into a session."""
        self.text.setText(
            f"A protocol runs into {session}. It goes on without this window: open the window "
            "again to join it."
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
        self._finder = EngineFinder(find)
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
        self._finder.search(self._announce)

    def list_engines(self) -> None:
        """List the running engines; say so where there are none."""
        self._finder.search(self._list)

    def leave(self) -> None:
        """Close the window without a question; a run goes on."""
        self._confirm()

    def may_close(self) -> bool:
        """Return whether the window may close now; else ask what becomes of the run."""
        running = [link for link in self._links if link.status.run.is_active]
        if self._may_close or not running:
            return True
        self.closing.ask(str(running[0].status.run.session or "its session"))
        return False

    def close(self) -> None:
        """Forget a search and wait for its end."""
        self._finder.cancel()
        self._finder.wait()

    def _connect(
        self, link: EngineLink[Any, Any], shared: SharedControl, control: ControlStrip
    ) -> None:
        control.command_requested.connect(lambda command, args: link.request(command, **args))
        shared.history_received.connect(self._show_history)
        link.opened.connect(self.engines.closed)
        link.choice_needed.connect(partial(self._choose, link))
        link.status_changed.connect(lambda _: self._follow_run())
        link.closed.connect(lambda _: self._follow_run())

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
