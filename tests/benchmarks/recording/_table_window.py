"""Open a session in a window of its own process; print what its table takes as a JSON object."""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable
from functools import partial
from itertools import chain, product
from pathlib import Path
from typing import Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QApplication
from shiboken6 import delete

from gui.shell.main_window import MainWindow
from gui.widgets.theme import ThemeChoice

SIZE = (1400, 900)
SCROLLS = 300
WORDS = "B 80mm/s 250g committed"


class TableWindow:
    """A window on its Analysis tab, and what turns of its event loop cost."""

    def __init__(self) -> None:
        self.window = MainWindow(choice=ThemeChoice.LIGHT)
        self.window.resize(*SIZE)
        self._tab = self.window.analysis_tab
        self._trials = self._tab.panel.trials
        self._turns: list[float] = []

    def open(self, session: str, *, is_warm: bool) -> dict[str, float]:
        """Open a session, with the reader ready (``is_warm``) or with the window just shown."""
        self.window.show()
        self.window.show_panel("analysis")
        self._tab.prepare()
        self._turn_until(lambda: not (is_warm and self._tab.reader.is_busy))
        self._turns.clear()
        begun_s, begun_cpu_s = time.perf_counter(), processor_s(os.getpid())
        self._tab.panel.folder.setText(session)
        self._turn(self._tab.panel.open_button.click)
        self._turn_until(lambda: self._trials.model.rowCount() > 0)
        self._turn(self._trials.table.viewport().repaint)
        shown_s, shown_cpu_s = time.perf_counter(), processor_s(os.getpid())
        self._turn_until(lambda: self._tab.trial_view.data is not None)
        self._turn(lambda: None)  # the first trial is drawn in the turn after it arrives
        return {
            "shown_s": shown_s - begun_s,
            "processor_s": shown_cpu_s - begun_cpu_s,
            "plotted_s": time.perf_counter() - begun_s,
            "longest_ms": max(self._turns),
        }

    def use(self) -> dict[str, list[float]]:
        """Return the turns in ms of sorting by each column, of a filter's letters, of scrolling."""
        table, bar = self._trials.table, self._trials.table.verticalScrollBar()
        orders = (Qt.SortOrder.AscendingOrder, Qt.SortOrder.DescendingOrder)
        columns = range(self._trials.model.columnCount())
        lengths = [*range(1, len(WORDS) + 1), *range(len(WORDS) - 1, -1, -1)]
        places = np.linspace(bar.minimum(), bar.maximum(), SCROLLS).astype(int).tolist()
        return {
            "sort": self._each(lambda at: table.sortByColumn(*at), columns, orders),
            "filter": self._each(lambda at: self._trials.filter.setText(WORDS[: at[0]]), lengths),
            "scroll": self._each(lambda at: bar.setValue(at[0]), places),
        }

    def _each(self, action: Callable[[tuple[Any, ...]], object], *values: Any) -> list[float]:
        self._turns = []
        for at in product(*values):
            self._turn(partial(action, at))
        return self._turns

    def _turn(self, action: Callable[[], object]) -> None:
        """Do something and let the event loop turn; note the Qt thread's processor time in ms."""
        begun_s = time.thread_time()
        action()
        QApplication.processEvents()
        self._turns.append(1000 * (time.thread_time() - begun_s))

    def _turn_until(self, done: Callable[[], bool]) -> None:
        while not done():
            self._turn(lambda: None)
            time.sleep(0.001)


def processor_s(pid: int) -> float:
    """Return the processor time of a process and of those that it started, as Linux counts it."""
    of = Path(f"/proc/{pid}")
    fields = (of / "stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    own_s = sum(map(int, fields[11:13])) / os.sysconf("SC_CLK_TCK")
    children = [path.read_text(encoding="ascii").split() for path in of.glob("task/*/children")]
    return own_s + sum(processor_s(int(child)) for child in chain.from_iterable(children))


def main() -> None:
    """Measure once; the arguments are a session, and warm or cold."""
    session, start = sys.argv[1:]
    pg.mkQApp()
    table = TableWindow()
    opened = table.open(session, is_warm=start == "warm")
    print(json.dumps({**opened, **table.use()}))
    table.window.close()
    delete(table.window)
