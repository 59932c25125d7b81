"""Runs that wait for the present one to end."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QListWidget, QListWidgetItem, QVBoxLayout, QWidget

from gui.widgets.formatting import time_stamp
from gui.widgets.labels import label
from gui.widgets.layouts import group_box, hbox, push_button
from rigctl.acquisition.rpc.messages import RunStatus

_ARGUMENTS = Qt.ItemDataRole.UserRole
_LIST_PX = 66
WAITS = "The last run did not finish: look at it, then press Start next."


class RunQueue(QWidget):
    """A list of runs. The next one starts by itself where the last one is done.

    ``arguments`` returns those of the command start for the fields as they are now; a queued run
    keeps its fields, and gets the folder of the second in which it starts.
    """

    start_requested = Signal(dict)

    def __init__(self, arguments: Callable[[], dict[str, Any]]) -> None:
        super().__init__()
        self._arguments = arguments
        self._was_active = False
        self._can_start = False
        self._sent_folder = ""
        self.list = QListWidget()
        self.list.setFixedHeight(_LIST_PX)
        self.add_button = push_button(
            "Add", self._add, "Queue a run of the fields above; the window must stay open for it"
        )
        self.remove_button = push_button("Remove", self._remove)
        self.next_button = push_button("Start next", self._start_next)
        self.problem = label("", "bad", wraps=True)
        self.problem.hide()
        self._lay_out()
        self.list.currentRowChanged.connect(lambda _: self._enable())
        self.set_possible(can_add=False, can_start=False)

    @property
    def waits(self) -> bool:
        """Whether the next run waits for Start next, as the last one did not finish."""
        return bool(self.problem.text())

    def set_possible(self, *, can_add: bool, can_start: bool) -> None:
        """Allow to queue the fields above, and to start a run."""
        self.add_button.setEnabled(can_add)
        self._can_start = can_start
        self._enable()

    def show_run(self, run: RunStatus) -> None:
        """Take a run that has begun from the list, and start the next after one that is done."""
        if self._sent_folder and run.session == self._sent_folder:
            self._sent_folder = ""
            self.list.takeItem(0)
            self._enable()
        if self._was_active and run.has_ended and self.list.count():
            if run.state == "done":
                self._start_next()
            else:
                self._show_problem(WAITS)
        self._was_active = run.is_active

    def _add(self) -> None:
        arguments = self._arguments()
        item = QListWidgetItem(f"{Path(arguments['protocol']).stem}, seed {arguments['seed']}")
        item.setData(_ARGUMENTS, arguments)
        self.list.addItem(item)
        self._enable()

    def _remove(self) -> None:
        self.list.takeItem(max(self.list.currentRow(), 0))
        if not self.list.count():
            self._show_problem("")
        self._enable()

    def _start_next(self) -> None:
        queued = dict(self.list.item(0).data(_ARGUMENTS))
        stem = Path(queued["protocol"]).stem
        queued["out"] = str(Path(queued["out"]).with_name(f"{stem}-{time_stamp()}"))
        self._sent_folder = queued["out"]
        self._show_problem("")
        self.start_requested.emit(queued)

    def _show_problem(self, sentence: str) -> None:
        self.problem.setText(sentence)
        self.problem.setVisible(bool(sentence))

    def _enable(self) -> None:
        has_runs = self.list.count() > 0
        self.remove_button.setEnabled(has_runs)
        self.next_button.setEnabled(has_runs and self._can_start)

    def _lay_out(self) -> None:
        box, column = group_box("Queue", QVBoxLayout())
        column.addWidget(self.problem)
        column.addWidget(self.list)
        column.addLayout(hbox(self.add_button, self.remove_button, self.next_button))
        outer = QVBoxLayout(self)
        outer.setContentsMargins(0, 0, 0, 0)
        outer.addWidget(box)
