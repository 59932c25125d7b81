"""What a run needs before it starts: the protocol, the folder, the people, and the plan."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from PySide6.QtCore import QSignalBlocker, Qt, Signal
from PySide6.QtWidgets import QLineEdit, QPushButton, QVBoxLayout, QWidget

from gui.analysis.tasks.worker import Worker
from gui.protocol.run_tasks import PLAN_ROWS, PlanSummary
from gui.widgets.file_browser import PathKind, browse_button, folder_problem, new_files_folder
from gui.widgets.file_combo_box import ElidedComboBox
from gui.widgets.formatting import day_time, time_stamp
from gui.widgets.labels import label, show_text
from gui.widgets.layouts import form_layout, group_box, hbox
from gui.widgets.number_box import WholeNumberBox
from rigctl.config import resources

MAX_SEED = 2**31 - 1
MAX_NAME_LETTERS = 200
MAX_NOTE_LETTERS = 2000
FINISH_ROW = "Would finish"
REMEMBERED = ("out", "operator", "sensor")


class ProtocolForm(QWidget):
    """The fields of a run and the plan that they make; the worker makes it."""

    path_requested = Signal(object, object)
    checked = Signal()
    """The plan, the folder or the problem has changed."""
    planned = Signal(object)
    """The summary of a plan that can run."""

    def __init__(self, worker: Worker) -> None:
        super().__init__()
        self._worker = worker
        self._next_plan: tuple[str, int | None] | None = None
        self._plan = PlanSummary()
        self._rig_toml, self._was_requested = "", False
        self.is_planned = False
        self.protocol = ElidedComboBox()
        self.out = QLineEdit(str(Path.home() / "rigctl-sessions"))
        self.out.setToolTip("Every session gets a new folder in here")
        self.seed = WholeNumberBox(maximum=MAX_SEED)
        self.seed.setToolTip("Seed of the random order of trials; stored with the session")
        self.operator = QLineEdit(maxLength=MAX_NAME_LETTERS)
        self.operator.setToolTip("Who records: stored with the session, remembered for the next")
        self.sensor = QLineEdit(maxLength=MAX_NAME_LETTERS)
        self.sensor.setToolTip("Which sensor is mounted: stored with the session, remembered")
        self.notes = QLineEdit(maxLength=MAX_NOTE_LETTERS)
        self.notes.setToolTip("Becomes the first note of the session")
        for field in (self.operator, self.sensor):
            field.setPlaceholderText("as in rig.toml")
        requested = self.path_requested
        self.open_button = browse_button(requested, PathKind.PROTOCOL, self.add_protocol)
        self.out_button = browse_button(requested, PathKind.OUTPUT, self.out.setText)
        self.edit_button = QPushButton("Edit")
        self.edit_button.setToolTip(
            "Edit in a form or as text; a protocol of the program is saved anew"
        )
        self.description = label("", wraps=True)
        self.plan_rows = {name: label("–", wraps=True) for name in (*PLAN_ROWS, FINISH_ROW)}
        self.problem = label("", "bad", wraps=True)
        self._lay_out()
        self._connect()
        self._list_protocols()

    def add_protocol(self, path: str) -> None:
        """Add a file to the list and choose it; plan it again if it is chosen already."""
        place = self.protocol.findData(path)
        if place < 0:
            self.protocol.addItem(Path(path).name, path)
            place = self.protocol.findData(path)
        if place == self.protocol.currentIndex():
            self.request_plan()
        self.protocol.setCurrentIndex(place)

    def set_rig(self, rig_toml: str) -> None:
        """Plan for a rig; for the nominal one without a description."""
        if rig_toml != self._rig_toml:
            self._rig_toml = rig_toml
            if self._was_requested:
                self.request_plan(self.seed.value() if self.is_planned else None)

    def people(self) -> dict[str, str]:
        """Return who records with what, and the first note."""
        fields = {"operator": self.operator, "sensor": self.sensor, "notes": self.notes}
        return {name: field.text().strip() for name, field in fields.items()}

    def start_arguments(self) -> dict[str, Any]:
        """Return the arguments of the engine's command start, with a new folder of this second."""
        folder = f"{Path(self.protocol.currentText()).stem}-{time_stamp()}"
        out = str(new_files_folder(self.out.text()) / folder)
        path, seed = self.protocol.currentData(), self.seed.value()
        return {"protocol": path, "out": out, "seed": seed, "yes": False, **self.people()}

    def remembered(self) -> dict[str, str]:
        """Return what the next start of the window asks no more."""
        return {name: getattr(self, name).text() for name in REMEMBERED}

    def restore(self, values: Mapping[str, str]) -> None:
        """Fill in what an earlier window remembered."""
        for name in REMEMBERED:
            if values.get(name):
                getattr(self, name).setText(values[name])

    @property
    def current_problem(self) -> str:
        """What keeps a run from starting; empty for nothing."""
        problem = folder_problem(self.out.text())
        seed = f"Seed: {self.seed.refusal}" if self.seed.refusal else ""
        return seed or self._plan.problem or (f"Save in: {problem}" if problem else "")

    def show_plan(self, plan: PlanSummary) -> None:
        """Show the plan of the chosen protocol, or why it cannot run."""
        self._plan, self.is_planned = plan, not plan.problem
        for name, text in zip(PLAN_ROWS, plan.texts, strict=True):
            show_text(self.plan_rows[name], text)
        show_text(self.description, plan.description)
        self.description.setVisible(bool(plan.description))
        with QSignalBlocker(self.seed):
            self.seed.setValue(plan.seed)
        self.show_finish()
        self.show_problem()
        if self.is_planned:
            self.planned.emit(plan)

    def show_finish(self) -> None:
        """Show when a run that starts now would end."""
        finish = day_time(self._plan.duration_s) if self.is_planned else "–"
        show_text(self.plan_rows[FINISH_ROW], finish)

    def show_problem(self) -> None:
        """Say what the fields lack for a run."""
        show_text(self.problem, self.current_problem)
        self.problem.setVisible(bool(self.current_problem))
        self.checked.emit()

    def request_plan(self, seed: int | None = None) -> None:
        """Request a plan, and drop a waiting request; no run starts until the plan arrives."""
        self.is_planned, self._was_requested = False, True
        if path := self.protocol.currentData():
            self._next_plan = (path, seed)
            self.submit_plan()

    def submit_plan(self) -> None:
        """Plan what was requested last, if the worker is free."""
        if self._next_plan is not None and not self._worker.is_busy:
            (path, seed), self._next_plan = self._next_plan, None
            values = {"seed": seed, "out": self.out.text(), "rig_toml": self._rig_toml}
            self._worker.submit("plan_protocol", path=path, **values)

    def finish_plan(self, plan: PlanSummary) -> None:
        """Show a plan that arrived, unless another one was requested meanwhile."""
        if self._next_plan is None:
            self.show_plan(plan)

    @property
    def needs_plan(self) -> bool:
        """Whether the chosen protocol was never planned."""
        return not self.is_planned and not self._plan.problem

    def _list_protocols(self) -> None:
        """List the protocols of the program, the quick one first."""
        paths = resources.protocols().glob("*.toml")
        for path in sorted(paths, key=lambda path: (path.stem != "quick", path.stem)):
            self.protocol.addItem(path.stem, str(path))
            index = self.protocol.count() - 1
            self.protocol.setItemData(index, str(path), Qt.ItemDataRole.ToolTipRole)

    def _connect(self) -> None:
        self.protocol.currentIndexChanged.connect(lambda _: self.request_plan())
        self.seed.valueChanged.connect(lambda _: self.request_plan(self.seed.value()))
        self.seed.refusal_changed.connect(self.show_problem)
        self.out.textChanged.connect(lambda _: self.show_problem())

    def _lay_out(self) -> None:
        box, form = group_box("Protocol", form_layout(4))
        form.addRow("File", hbox(self.protocol, self.open_button, self.edit_button))
        form.addRow(self.description)
        for name, text in self.plan_rows.items():
            form.addRow(label(name, "muted"), text)
        form.addRow(self.problem)
        form.addRow("Save in", hbox(self.out, self.out_button))
        form.addRow("Seed", self.seed)
        form.addRow("Operator", self.operator)
        form.addRow("Sensor", self.sensor)
        form.addRow("First note", self.notes)
        for hidden in (self.description, self.problem):
            hidden.hide()
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.addWidget(box)
