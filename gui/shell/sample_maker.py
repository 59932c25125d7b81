"""Makes the sample session in a thread, so that the window waits for neither disk nor command."""

from __future__ import annotations

import threading

from PySide6.QtCore import QElapsedTimer, QObject, Qt, QTimer, Signal
from PySide6.QtWidgets import QWidget

from gui.widgets.labels import label, set_property
from gui.widgets.layouts import hbox, push_button, vbox
from rigctl.errors import RigctlError
from rigctl.synth.sample_session import SYNTH, SampleSession, sample_folder

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


_JOIN_LIMIT_S = 10.0


class SampleMaker(QObject):
    """Provides one sample session at a time; :meth:`start` does nothing while it is busy."""

    told = Signal(str, str)
    """The present stage, and the last line that its command printed."""
    remarked = Signal(str)
    """What happened to a damaged one, before :attr:`ready`."""
    ready = Signal(str)
    """The folder of a whole session."""
    cancelled = Signal()
    """The command has ended, and what it made is gone."""
    failed = Signal(str)
    """One sentence."""
    _ended = Signal(bool, str)

    def __init__(self) -> None:
        super().__init__()
        self._sample: SampleSession | None = None
        self._thread: threading.Thread | None = None
        # The thread emits, the window's thread acts.
        self._ended.connect(self._end, Qt.ConnectionType.QueuedConnection)

    @property
    def is_busy(self) -> bool:
        """Whether a session is being checked or made."""
        return self._sample is not None

    def start(self) -> None:
        """Check the sample session and make it if need be; a signal tells how that ended."""
        if self._sample is None:
            sample = self._sample = SampleSession(sample_folder(), self.told.emit)
            self._thread = threading.Thread(
                target=self._provide, args=(sample,), name="rigctl-sample-session"
            )
            self._thread.start()

    def cancel(self) -> None:
        """End the command; :attr:`cancelled` follows once it has ended."""
        if self._sample is not None:
            self._sample.cancel()

    def close(self) -> None:
        """End the command, and wait until what it has made is gone."""
        self.cancel()
        self._sample = None
        if self._thread is not None:
            self._thread.join(_JOIN_LIMIT_S)

    def _provide(self, sample: SampleSession) -> None:
        try:
            self._ended.emit(sample.provide(), "")
        except RigctlError as error:
            self._ended.emit(False, str(error))

    def _end(self, is_ready: bool, sentence: str) -> None:
        sample, self._sample = self._sample, None
        if sample is None:  # the window has closed
            return
        if sample.remark:
            self.remarked.emit(sample.remark)
        if is_ready:
            self.ready.emit(str(sample.folder))
        elif sentence:
            self.failed.emit(sentence)
        else:
            self.cancelled.emit()
