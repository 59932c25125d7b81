"""Work beside the window's thread: what comes of it arrives in the window's thread."""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import TypeVar

from PySide6.QtCore import QObject, Qt, Signal

from rigctl.errors import RigctlError

UNEXPECTED = "an error that nobody expected: Help → Crash reports says more"
_CLOSE_TIMEOUT_S = 30.0
_Result = TypeVar("_Result")


class Background(QObject):
    """Runs functions in threads of their own, as many as are asked for."""

    _ended = Signal(object, object)

    def __init__(self, name: str) -> None:
        super().__init__()
        self._name, self._is_closed = name, False
        self._threads: list[threading.Thread] = []
        self._ended.connect(self._tell, Qt.ConnectionType.QueuedConnection)

    def run(
        self,
        work: Callable[[], _Result],
        done: Callable[[_Result], object],
        failed: Callable[[str], object],
    ) -> None:
        """Start ``work``; then call ``done`` with its result, or ``failed`` with a sentence."""
        thread = threading.Thread(
            target=self._run, args=(work, done, failed), name=self._name, daemon=True
        )
        self._threads.append(thread)
        self._is_closed = False
        thread.start()

    def close(self, timeout_s: float = _CLOSE_TIMEOUT_S) -> None:
        """Wait for what goes on, as before the window closes, and tell nothing of it."""
        self._is_closed = True
        for thread in self._threads:
            thread.join(timeout_s)

    def _run(
        self,
        work: Callable[[], _Result],
        done: Callable[[_Result], object],
        failed: Callable[[str], object],
    ) -> None:
        tell: Callable[[], object] = partial(failed, UNEXPECTED)
        try:
            tell = partial(done, work())
        except RigctlError as error:
            tell = partial(failed, str(error))
        finally:
            with suppress(RuntimeError):  # the window and its objects have gone meanwhile
                self._ended.emit(threading.current_thread(), tell)

    def _tell(self, thread: threading.Thread, tell: Callable[[], object]) -> None:
        thread.join()  # it has told: what it held, such as a picture, ends in this thread
        self._threads.remove(thread)
        if not self._is_closed:
            tell()
