"""The age of every sample when a window has painted it, by the stations of its way."""

from __future__ import annotations

import os
import tempfile
import threading
import time
from typing import TYPE_CHECKING, NamedTuple
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray

from rigctl.engine.live_file import LiveReader
from rigctl.engine.rpc.engine_files import FOLDER_VARIABLE

if TYPE_CHECKING:
    from gui.shell.main_window import MainWindow

STATIONS = ("cable", "engine", "look", "paint")
"""Waiting for the cable's delivery; driver, encoder and live file; the window's look; painting."""
_WATCH_S = 0.0005
_WARM_UP = 30


class PaintedBlock(NamedTuple):
    """New samples ``first_s`` … ``newest_s`` (engine's time), and when they passed each station."""

    first_s: float
    newest_s: float
    written_s: float
    looked_s: float
    painted_s: float


class SampleAges:
    """Collects when samples came into the live file, were taken, and were painted."""

    def __init__(self, window: MainWindow) -> None:
        self._page = window.live_page
        self._written_s: dict[int, float] = {}
        self._looked_s = self._seen_s = 0.0
        self._ends = threading.Event()
        self.blocks: list[PaintedBlock] = []
        self.offsets_s: list[float] = []

    def on_status(self, at_s: float) -> None:
        """Store the clock offset of a status of engine time ``at_s``."""
        self.offsets_s.append(time.monotonic() - at_s)

    def watch(self, live: LiveReader) -> threading.Thread:
        """Note when rows come into the live file, in a thread, until :meth:`end`."""
        thread = threading.Thread(target=self._watch, args=(live,), name="live-file-watch")
        thread.start()
        return thread

    def end(self) -> None:
        """End the watch."""
        self._ends.set()

    def refresh(self, live: LiveReader) -> None:
        """Take and prepare new samples as the page does, and note when."""
        self._looked_s = time.monotonic()
        type(self._page).refresh(self._page, live)

    def on_paint(self) -> None:
        """Store the time at which the samples of the history are on the screen."""
        history = self._page.plots.data.history
        newest_s = history.newest_s
        if newest_s > self._seen_s > 0 and self.offsets_s:
            now_s = time.monotonic()
            written_s = self._written_s.get(history.head, self._looked_s)
            block = PaintedBlock(self._seen_s, newest_s, written_s, self._looked_s, now_s)
            self.blocks.append(block)
        self._seen_s = newest_s

    def shares_ms(self) -> NDArray[np.float64]:
        """Return what each station took of each sample after a second, (n, 4)."""
        offset_s = min(self.offsets_s)
        return np.concatenate([_shares_ms(block, offset_s) for block in self.blocks[_WARM_UP:]])

    def _watch(self, live: LiveReader) -> None:
        seen = 0
        while not self._ends.wait(_WATCH_S):
            if (head := live.taxel_head) != seen:
                seen = head
                self._written_s[head] = time.monotonic()


def _shares_ms(block: PaintedBlock, offset_s: float) -> NDArray[np.float64]:
    newest_s = block.newest_s + offset_s
    cable = np.arange(0.0, block.newest_s - block.first_s - 1e-6, 0.001)
    passed = np.diff([newest_s, block.written_s, block.looked_s, block.painted_s])
    return 1000 * np.column_stack([cable, np.tile(passed, (len(cable), 1))])


def measured_shares_ms(size: tuple[int, int], seconds: float) -> NDArray[np.float64]:
    """Return the stations' shares of every sample's age, (n, 4) ms, on a rig in real time.

    The fastest status message gives the offset of the engine's clock, so an age is too long by
    at most the latency of that message.
    """
    import pyqtgraph as pg
    from PySide6.QtCore import QTimer
    from PySide6.QtTest import QTest
    from shiboken6 import delete

    from gui.shell.main_window import MainWindow
    from gui.widgets.theme import ThemeChoice

    pg.mkQApp()
    with tempfile.TemporaryDirectory() as folder:
        os.environ[FOLDER_VARIABLE] = folder
        window = MainWindow(choice=ThemeChoice.LIGHT)
        window.resize(*size)
        window.show()
        ages = SampleAges(window)
        window.live_page.timer.timeout.connect(lambda: QTimer.singleShot(0, ages.on_paint))
        window.engine_link.status_changed.connect(lambda status: ages.on_status(status.at_s))
        window.connect_rig("virtual")
        while not ages.offsets_s or window.engine_link.live is None:
            QTest.qWait(50)
        with patch.object(window.live_page, "refresh", ages.refresh):
            thread = ages.watch(window.engine_link.live)
            QTest.qWait(round(1000 * seconds))
            ages.end()
            thread.join()
        window.close()
        delete(window)
    return ages.shares_ms()
