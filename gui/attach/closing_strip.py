"""The question whether to leave a run, in a strip: nothing covers STOP."""

from __future__ import annotations

from PySide6.QtCore import Signal

from gui.attach.strip import Strip
from gui.widgets.layouts import push_button


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
