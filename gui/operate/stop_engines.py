"""STOP for all engines of this user, in threads: the window never waits."""

from __future__ import annotations

import threading
from collections.abc import Collection

from PySide6.QtCore import QObject, Signal

from rigctl.acquisition.rpc.stop_all import StopResult, stop_engines
from rigctl.errors import RigctlError

NO_ENGINE = "STOP: no engine is running; press the rig's emergency stop if the drum moves"


class EngineStopper(QObject):
    """Stops engines and reports each result. Qt passes the signal to the window's thread."""

    reported = Signal(str, str)
    """Kind and text for the event log."""

    def __init__(self) -> None:
        super().__init__()
        self._threads: list[threading.Thread] = []

    def stop(self, exclude: Collection[str] = ()) -> None:
        """Stop every engine except those that the caller has stopped; returns at once."""
        self._threads = [thread for thread in self._threads if thread.is_alive()]
        thread = threading.Thread(target=self._stop, args=(exclude,), name="rigctl-stop")
        self._threads.append(thread)
        thread.start()

    def wait(self) -> None:
        """Wait for the threads, which end within seconds."""
        for thread in self._threads:
            thread.join()

    def _stop(self, exclude: Collection[str]) -> None:
        try:
            if not stop_engines(self._report, exclude) and not exclude:
                self.reported.emit("stop", NO_ENGINE)
        except RigctlError as error:
            self.reported.emit("lost", f"STOP reached no engine: {error}")

    def _report(self, result: StopResult) -> None:
        if result.failure:
            text = f"STOP did not reach {result.name}: press its emergency stop ({result.failure})"
            self.reported.emit("lost", text)
        else:
            self.reported.emit("stop", f"STOP reached {result.name}")
