"""A form with the options of ``rigctl analyse``, made from their declarations."""

from __future__ import annotations

from dataclasses import Field
from itertools import count
from pathlib import Path
from typing import Any

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QCheckBox, QLineEdit, QWidget

from gui.analysis.tasks.task_values import DRUM, FINGER, model_path
from gui.widgets.file_browser import PathKind, browse_button, typed_path
from gui.widgets.labels import label, plain_tooltip, show_text
from gui.widgets.layouts import combo_box, container, form_layout, hbox, push_button, vbox
from gui.widgets.number_box import NumberBox, WholeNumberBox, has_refused
from rigctl.analysis.options import DRUM as DRUM_ANALYSIS
from rigctl.analysis.options import FINGER as FINGER_ANALYSIS
from rigctl.analysis.options import AnalysisOptions, declared

ROWS = (
    "task", "settings", "iterations", "k_max", "preset", "reference_force", "seed", "engine", "c",
    "representation", "sensitivity",
)  # fmt: skip
FILES = {"settings": PathKind.ANALYSIS_FILE, "c": PathKind.MODEL}
EXPERIMENTS = {DRUM: DRUM_ANALYSIS, FINGER: FINGER_ANALYSIS}
DRAWS = {DRUM: 20, FINGER: 100}
"""The paper's number of draws in each experiment."""


class AnalysisOptionsForm(QWidget):
    """The sessions and options of an analysis; the open session is always the first one.

    ``session_row`` names the sessions; the panel shows it above their trials. ``fields``: those of
    the options, by name.
    """

    path_requested = Signal(object, object)
    sessions_changed = Signal(tuple)
    """The paths of the sessions to analyse, the open one first."""

    def __init__(self) -> None:
        super().__init__()
        self.session_names = label("–", wraps=True)
        requested = self.path_requested
        self.add_button = browse_button(requested, PathKind.SESSION, self.add_session, "+")
        self.add_button.setToolTip("Add another session")
        self.add_button.setAccessibleName("Add another session")
        self.remove_button = push_button("−", self._remove_added, "Remove the added sessions")
        self.remove_button.setAccessibleName("Remove the added sessions")
        heading = hbox(label("Sessions"), self.add_button, self.remove_button)
        self.session_row = container(vbox(heading, self.session_names))
        self._experiment = DRUM
        self._open_session = ""
        self._added: list[str] = []
        self._declared = declared(AnalysisOptions)
        self.fields: dict[str, Any] = {n: _make_field(self._declared[n]) for n in ROWS}
        self._form = form_layout(4)
        self._rows = {name: self._add_row(name) for name in ROWS}
        self.setLayout(self._form)
        task, settings = self.fields["task"], self.fields["settings"]
        # A list that is too long for the place beside its name stands below it.
        task.setMinimumContentsLength(max(len(task.itemText(i)) for i in range(task.count())))
        settings.textChanged.connect(self._show_reference)
        self._show_sessions()

    def show_experiment(self, experiment: str) -> None:
        """Show the options of an experiment's analysis, with its usual number of draws."""
        if experiment == self._experiment:
            return
        self._experiment = experiment
        self.fields["iterations"].setValue(DRAWS[experiment])
        for name, row in self._rows.items():
            if self._declared[name].metadata["drum"]:
                self._form.setRowVisible(row, experiment == DRUM)

    def show_session(self, path: str) -> None:
        """Make another session the open one."""
        self._open_session = path
        self._added = []
        self._show_sessions()

    def add_session(self, path: str) -> None:
        """Analyse this session together with the open one."""
        if path not in self.sessions:
            self._added.append(path)
        self._show_sessions()
        self.sessions_changed.emit(self.sessions)

    def remove_session(self, path: str) -> None:
        """Do not analyse an added session."""
        self._added = [added for added in self._added if added != path]
        self._show_sessions()
        self.sessions_changed.emit(self.sessions)

    @property
    def sessions(self) -> tuple[str, ...]:
        """Return the session folders, the open one first."""
        return (*((self._open_session,) if self._open_session else ()), *self._added)

    @property
    def has_refused(self) -> bool:
        """Whether a field has a refused text; the first one then says why, with the focus."""
        boxes = (field for field in self.fields.values() if isinstance(field, NumberBox))
        return has_refused(*(box for box in boxes if box.isVisible()))

    def options(self) -> AnalysisOptions:
        """Return the chosen options, with a new folder beside the open session."""
        chosen = {name: self._value(name) for name in ROWS}
        out = _new_folder(Path(self._open_session))
        if chosen["representation"]:
            chosen |= {"save_model": model_path(out), "components": chosen["k_max"]}
        if chosen["settings"] is not None:
            del chosen["reference_force"]
        experiment = EXPERIMENTS[self._experiment]
        return AnalysisOptions(
            tuple(map(Path, self.sessions)), out=out, experiment=experiment, **chosen
        )

    def _value(self, name: str) -> Any:
        """Return the value of an option; where a field is empty, its default."""
        field, default = self.fields[name], self._declared[name].default
        if isinstance(field, QCheckBox):
            return field.isChecked()
        if isinstance(field, NumberBox):
            return field.value()
        if isinstance(field, QLineEdit):
            text = field.text()
            return typed_path(text) if text.strip() else default
        value = field.currentData()
        if not value:
            return default
        return (value,) if isinstance(default, tuple) else value

    def _show_sessions(self) -> None:
        names = ", ".join(Path(path).name for path in self.sessions)
        show_text(self.session_names, names or "–")
        self.session_names.setToolTip(plain_tooltip("\n".join(self.sessions)))
        self.add_button.setEnabled(bool(self._open_session))
        self.remove_button.setEnabled(bool(self._added))

    def _show_reference(self, settings: str) -> None:
        """Let the reference force be chosen only where no analysis file says it."""
        self.fields["reference_force"].setEnabled(not settings.strip())

    def _remove_added(self) -> None:
        self._added.clear()
        self._show_sessions()
        self.sessions_changed.emit(self.sessions)

    def _add_row(self, name: str) -> Any:
        """Add the row of an option; return what stands in it."""
        title, field = self._declared[name].metadata["title"], self.fields[name]
        if isinstance(field, QLineEdit):
            row = hbox(field, browse_button(self.path_requested, FILES[name], field.setText))
            self._form.addRow(title, row)
            return row
        if isinstance(field, QCheckBox):
            self._form.addRow(field)
        elif name == "representation":
            field = container(vbox(label(title), field))
            self._form.addRow(field)
        else:
            self._form.addRow(title, field)
        return field


def _make_field(one: Field[Any]) -> QWidget:
    """Return the field of an option; it begins with the usual value."""
    values, usual = one.metadata, one.metadata["usual"]
    kind = str(one.type).removesuffix(" | None")
    field: QWidget
    if values["offered"]:
        field = combo_box({text: value for value, text in values["offered"]})
    elif kind == "bool":
        field = QCheckBox(values["title"])
    elif kind == "int":
        low, high = int(values["low"]), int(min(values["high"], 2**31 - 1))
        field = WholeNumberBox(minimum=low, maximum=high, value=usual or 0)
    elif kind == "float":
        field = NumberBox(decimals=1, maximum=values["high"], value=usual, suffix=" g")
    else:
        field = QLineEdit(placeholderText=usual)
    field.setToolTip(values["hint"])
    return field


def _new_folder(session: Path) -> Path:
    """Return a new folder for a report beside the session; its name ends in a number."""
    folders = (session.with_name(f"{session.name}-report-{number}") for number in count(1))
    return next(f for f in folders if not f.exists() and not model_path(f).exists())
