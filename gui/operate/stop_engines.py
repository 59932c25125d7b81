"""STOP for all engines of this user, in a thread: the window waits for nothing."""

from __future__ import annotations

import threading
from collections.abc import Collection
from queue import Empty, SimpleQueue

from PySide6.QtCore import QObject, Signal

from rigctl.acquisition.rpc.stop_all import StopResult, stop_engines
from rigctl.errors import RigctlError

NOTHING = "STOP: no engine is running; use the rig's emergency stop if it moves"


class EngineStopper(QObject):
    """Stops engines; :meth:`poll`, in the window's thread, says which were reached."""

    said = Signal(str, str)
    """Kind and text for the window's log."""

    def __init__(self) -> None:
        super().__init__()
        self._said: SimpleQueue[tuple[str, str]] = SimpleQueue()
        self._threads: list[threading.Thread] = []

    def stop(self, but: Collection[str] = ()) -> None:
        """Stop every engine but those named, which somebody else has stopped; returns at once."""
        self._threads = [thread for thread in self._threads if thread.is_alive()]
        thread = threading.Thread(target=self._stop, args=(but,), name="rigctl-stop")
        self._threads.append(thread)
        thread.start()

    def poll(self) -> None:
        """Hand on what was reached since the last call."""
        while True:
            try:
                self.said.emit(*self._said.get_nowait())
            except Empty:
                return

    def wait(self) -> None:
        """Wait for the threads, which end within seconds."""
        for thread in self._threads:
            thread.join()

    def _stop(self, but: Collection[str]) -> None:
        try:
            if not stop_engines(self._tell, but) and not but:
                self._said.put(("stop", NOTHING))
        except RigctlError as error:
            self._said.put(("lost", f"STOP reached no engine: {error}"))

    def _tell(self, stopped: StopResult) -> None:
        if stopped.failure:
            text = f"STOP did not reach {stopped.name}, press its emergency stop: {stopped.failure}"
            self._said.put(("lost", text))
        else:
            self._said.put(("stop", f"STOP reached {stopped.name}"))
