"""The engines that run already: found in a thread, listed on a page to choose one of them."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import partial

from PySide6.QtCore import QObject, Qt, Signal
from PySide6.QtWidgets import QPushButton, QWidget

from gui.widgets.labels import label
from gui.widgets.layouts import container, hbox, push_button, vbox
from rigctl.acquisition.rpc.client import FoundEngine, find_engines
from rigctl.acquisition.rpc.engine_files import EngineFile
from rigctl.errors import RigctlError

FindEngines = Callable[[], list[FoundEngine]]
JOIN_LIMIT_S = 10.0
SHOWN_ENGINES = 8
"""More would not fit on a small screen; the newest are shown."""


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


class EnginesPage(QWidget):
    """Lists engines, each with *Join*; *Start another one* only where that is offered."""

    join_requested = Signal(EngineFile)
    start_requested = Signal()
    shown = Signal()
    closed = Signal()

    def __init__(self) -> None:
        super().__init__()
        self.join_buttons: list[QPushButton] = []
        self.text = label("", "heading", wraps=True)
        self.start_button = push_button("Start another one", self._start)
        self.dismiss_button = push_button("Not now", self.closed.emit)
        heading = hbox(self.text, self.start_button, self.dismiss_button, spacing=6)
        self._rows: list[QWidget] = []
        self._column = vbox(spacing=4)
        column = vbox(
            container(heading), container(self._column), spacing=8, margins=(12, 10, 8, 8)
        )
        column.addStretch(1)
        self.setLayout(column)

    def show_engines(self, text: str, engines: list[FoundEngine], *, may_start: bool) -> None:
        """Show a sentence and the engines to join."""
        self._clear()
        left_out = len(engines) - SHOWN_ENGINES
        more = f" {left_out} older ones are not shown." if left_out > 0 else ""
        self.text.setText(text + more)
        for engine in engines[:SHOWN_ENGINES]:
            self._add(engine)
        self.start_button.setVisible(may_start)
        self.shown.emit()

    def _clear(self) -> None:
        for row in self._rows:
            self._column.removeWidget(row)
            row.hide()
            row.deleteLater()
        self._rows, self.join_buttons = [], []

    def _add(self, found: FoundEngine) -> None:
        button = push_button("Join", partial(self._join, found.engine), f"Join {found.name}")
        button.setAccessibleName(f"Join {found.name}")
        words = label(f"{found.name}: {found.describe()}", wraps=True)
        row = container(hbox(words, button, spacing=6, margins=(0, 0, 0, 4)))
        self._rows.append(row)
        self.join_buttons.append(button)
        self._column.addWidget(row)

    def _join(self, engine: EngineFile) -> None:
        self.closed.emit()
        self.join_requested.emit(engine)

    def _start(self) -> None:
        self.closed.emit()
        self.start_requested.emit()
