"""How far the sample session is, with Cancel, and why it was not made."""

from __future__ import annotations

from PySide6.QtCore import QElapsedTimer, QTimer, Signal
from PySide6.QtWidgets import QWidget

from gui.widgets.labels import label, set_property
from gui.widgets.layouts import hbox, push_button, vbox
from rigctl.synth.sample_session import SYNTH

REMEDY = (
    "Then press the button again. To have one in a folder of your own, use "
    f"rigctl {' '.join(SYNTH)} --out FOLDER and open it here."
)
CANCELLED = "Cancelled: no sample session was made."
CANCELLING = "Cancelling …"
_MS = 1000


class SampleBox(QWidget):
    """A line that counts the seconds of the present stage; hidden while there is nothing to say."""

    cancel_requested = Signal()

    def __init__(self) -> None:
        super().__init__()
        self.text, self.remedy = label(wraps=True), label(REMEDY, wraps=True)
        self.cancel_button = push_button("Cancel", self._cancel, "No sample session is made then")
        self._stage = self._line = ""
        self._is_cancelling = False
        self._since = QElapsedTimer()
        self._timer = QTimer(self, interval=_MS)
        self._timer.timeout.connect(self._count)
        first = hbox(self.cancel_button, self.text, wide=1, spacing=8)
        self.setLayout(vbox(first, self.remedy, spacing=6))
        self.hide()

    def show_progress(self, stage: str, line: str) -> None:
        """Show a stage and the last line of its command, and count the seconds."""
        if self._is_cancelling:
            return
        if stage != self._stage:
            self._since.start()
        self._stage, self._line = stage, line
        self._timer.start()
        self._show("", is_running=True)
        self._count()

    def show_failure(self, sentence: str) -> None:
        """Show why there is no sample session, and what to do."""
        self._end(f"The sample session was not made: {sentence}", "bad")
        self.remedy.show()

    def show_cancelled(self) -> None:
        """Show that there is no sample session, as the user wanted."""
        self._end(CANCELLED, "muted")

    def clear(self) -> None:
        """Say nothing more."""
        self._end("", "")
        self.hide()

    def _cancel(self) -> None:
        self._timer.stop()
        self._is_cancelling = True
        self.cancel_button.setEnabled(False)
        self.text.setText(CANCELLING)
        self.cancel_requested.emit()

    def _count(self) -> None:
        seconds = self._since.elapsed() // _MS
        self.text.setText(f"{self._stage}, {seconds} s{f': {self._line}' if self._line else ' …'}")

    def _end(self, text: str, role: str) -> None:
        self._timer.stop()
        self._stage, self._is_cancelling = "", False
        self._show(role, is_running=False)
        self.text.setText(text)

    def _show(self, role: str, *, is_running: bool) -> None:
        set_property(self.text, "role", role)
        self.cancel_button.setVisible(is_running)
        self.cancel_button.setEnabled(is_running)
        self.remedy.hide()
        self.show()
