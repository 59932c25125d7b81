"""Makes the sample session in a thread, so that the window waits for neither disk nor command."""

from __future__ import annotations

import threading

from PySide6.QtCore import QObject, Qt, Signal

from rigctl.errors import RigctlError
from rigctl.synth.sample_session import SampleSession, sample_folder

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
