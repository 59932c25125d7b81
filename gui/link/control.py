"""Who has control of the engine that a window shares: asked for, given, taken; others watch."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import msgspec
from PySide6.QtCore import QEvent, QObject, Signal
from PySide6.QtWidgets import QWidget

from gui.link.engine_link import EngineLink, name_this_window
from gui.widgets.layouts import push_button
from gui.widgets.strip import Strip
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
        self.setLayout(self.row(self.ask, self.take, self.give))
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
        if control.toolTip() != self._reason:
            self._tooltips[control] = control.toolTip()
            control.setToolTip(self._reason)
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
