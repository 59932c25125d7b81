"""A window as one of several clients of its engine: who has control, and the log until now."""

from __future__ import annotations

from typing import Any

import msgspec
from PySide6.QtCore import QObject, Signal

from gui.engine_dialect import UNREADABLE, name_this_window, other_version
from gui.engine_link import EngineLink
from rigctl.acquisition.rpc.client import WINDOW, client_name
from rigctl.acquisition.rpc.messages import ControlState


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
        """Take what the engine tells a window that joins; another version's may lack something."""
        number, events = result.get("client"), result.get("events")
        if command == "introduce" and isinstance(number, int):
            self.number = number
            self._show(result.get("control"))
        elif command == "history" and isinstance(events, list):
            try:
                past = [
                    (float(e["age_s"]), str(e["kind"]), name_this_window(str(e["text"])))
                    for e in events
                ]
            except UNREADABLE:
                self._link.reported.emit("lost", other_version("log of before"))
            else:
                self.history_received.emit(past)

    def _take_event(self, message: dict[str, Any]) -> None:
        if message.get("event") == "control":
            self._show(message.get("data"))

    def _show(self, data: Any) -> None:
        try:
            self.state = msgspec.convert(data or {}, ControlState)
        except UNREADABLE:
            self._link.reported.emit("lost", other_version("list of clients"))
            return
        self.changed.emit()
