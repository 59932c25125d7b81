"""The page of the engines that run already, to choose one of them."""

from __future__ import annotations

from functools import partial

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QPushButton, QWidget

from gui.widgets.labels import label
from gui.widgets.layouts import container, hbox, push_button, vbox
from rigctl.acquisition.rpc.client import FoundEngine
from rigctl.acquisition.rpc.engine_files import EngineFile

SHOWN_ENGINES = 8
"""More would not fit on a small screen; the newest are shown."""


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
