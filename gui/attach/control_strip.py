"""Who has control of the rig, where a window is not alone with it."""

from __future__ import annotations

from PySide6.QtCore import Signal

from gui.attach.shared_control import SharedControl
from gui.attach.strip import Strip
from gui.widgets.layouts import push_button


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
