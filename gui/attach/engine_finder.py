"""The search for running engines, in a thread."""

from __future__ import annotations

import threading
from collections.abc import Callable

from PySide6.QtCore import QObject, Qt, Signal

from rigctl.acquisition.rpc.client import FoundEngine, find_engines
from rigctl.errors import RigctlError

FindEngines = Callable[[], list[FoundEngine]]
JOIN_LIMIT_S = 10.0


class EngineFinder(QObject):
    """Asks all running engines what they do; one search at a time."""

    found = Signal(list)
    """The :class:`FoundEngine` of each."""
    failed = Signal(str)
    """One sentence."""

    def __init__(self, find: FindEngines = find_engines) -> None:
        super().__init__()
        self._find = find
        self._thread: threading.Thread | None = None
        self._told: Callable[[list[FoundEngine]], None] | None = None
        queued = Qt.ConnectionType.QueuedConnection  # the thread emits, the window's thread acts
        self.found.connect(self._tell, queued)
        self.failed.connect(self._fail, queued)

    def search(self, told: Callable[[list[FoundEngine]], None]) -> None:
        """Search, then call ``told`` in the window's thread.

        A search that is under way answers the later question instead of the earlier one.
        """
        self._told = told
        if self._thread is None or not self._thread.is_alive():
            self._thread = threading.Thread(target=self._search, name="rigctl-engine-finder")
            self._thread.start()

    def wait(self) -> None:
        """Wait for the end of a search, a few seconds at most."""
        if self._thread is not None:
            self._thread.join(JOIN_LIMIT_S)
            self._thread = None

    def cancel(self) -> None:
        """Forget a search that goes on."""
        self._told = None

    def _search(self) -> None:
        try:
            self.found.emit(self._find())
        except RigctlError as error:
            self.failed.emit(str(error))

    def _tell(self, engines: list[FoundEngine]) -> None:
        told, self._told = self._told, None
        if told is not None:
            told(engines)

    def _fail(self, _: str) -> None:
        self._tell([])
