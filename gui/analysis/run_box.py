"""Classification of textures: choice of the method, its options, progress and result."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import Field
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple

from PySide6.QtCore import QElapsedTimer, Signal
from PySide6.QtWidgets import QCheckBox, QGroupBox, QHBoxLayout, QLineEdit, QProgressBar, QWidget

from gui.analysis.task_values import DRUM, FINGER, model_path, results_folder
from gui.widgets.file_browser import PathKind, browse_button
from gui.widgets.formatting import duration
from gui.widgets.labels import label, plain_tooltip, set_property, show_text
from gui.widgets.layouts import combo_box, container, form_layout, hbox, push_button, vbox
from gui.widgets.number_box import NumberBox, WholeNumberBox, has_refused
from gui.widgets.typed_paths import typed_path
from rigctl.analysis.options import DRUM as DRUM_ANALYSIS
from rigctl.analysis.options import FINGER as FINGER_ANALYSIS
from rigctl.analysis.options import AnalysisOptions, declared

ROWS = (
    "task", "settings", "iterations", "k_max", "preset", "reference_force", "seed", "engine", "c",
    "also", "representation", "sensitivity",
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
        settings = self.fields["settings"]
        for field in (self.fields["task"], self.fields["also"]):
            # A list that is too long for the place beside its name stands below it.
            longest = max(len(field.itemText(i)) for i in range(field.count()))
            field.setMinimumContentsLength(longest)
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

    def options(self, place: Path) -> AnalysisOptions:
        """Return the chosen options, with a new folder in ``place`` for the report."""
        chosen = {name: self._value(name) for name in ROWS}
        out = _new_folder(place, typed_path(self._open_session).name)
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
        field = NumberBox(decimals=2, maximum=values["high"], value=usual, suffix=" g")
    else:
        field = QLineEdit(placeholderText=usual)
    field.setToolTip(values["hint"])
    return field


def _new_folder(place: Path, session: str) -> Path:
    """Return a new folder for a report on a session; its name ends in a number."""
    folders = (place / f"{session}-report-{number}" for number in count(1))
    return next(f for f in folders if not f.exists() and not model_path(f).exists())


BESIDE = "beside the session"
PLACE_TIP = (
    "Folder for figures, reports, models and movies, as a whole path or from ~ on; empty: beside "
    "the session, or in Save in of Protocol where nobody can write there"
)


class _Method(NamedTuple):
    name: str
    description: str
    button: str


QUICK, PAPER, MODEL, REALTIME = "quick", "paper", "model", "realtime"
METHODS = {
    QUICK: _Method(
        "Quick check",
        "PCA and LDA on speed-scaled features, tested on held-out trials of all sessions together.",
        "Classify",
    ),
    PAPER: _Method(
        "The paper's analysis",
        "All representations and tasks of the paper. Writes a report.",
        "Analyse",
    ),
    MODEL: _Method(
        "A trained model",
        "Classifies each trial with a saved model. The predictions appear on the right.",
        "Classify",
    ),
    REALTIME: _Method(
        "The moving finger's analysis",
        "Figures 4B, 4C and S5. Add the calibration and the run of a later session to a training "
        "session. Writes a report.",
        "Analyse",
    ),
}
METHODS_OF = {DRUM: (QUICK, PAPER, MODEL), FINGER: (REALTIME,)}
"""Methods for the sessions of each experiment."""


class AnalysisRunBox(QGroupBox):
    """The method and its options, Run and Cancel, progress and result."""

    run_requested = Signal(str)
    """The key of the method."""
    cancel_requested = Signal()
    results_requested = Signal()
    path_requested = Signal(object, object)

    def __init__(self) -> None:
        super().__init__("Classify textures")
        self.method = combo_box(_names(DRUM))
        self.description = label("", "muted", wraps=True)
        self.form = AnalysisOptionsForm()
        self.model = QLineEdit(placeholderText="Model file")
        requested = self.path_requested
        self.model_button = browse_button(requested, PathKind.MODEL, self.model.setText)
        self.model_row = container(hbox(self.model, self.model_button))
        self.place = QLineEdit(placeholderText=BESIDE)
        self.place.setToolTip(PLACE_TIP)
        self.fallback: Callable[[], str] = lambda: str(Path.home())
        """Returns the folder for results where the session's own cannot be written."""
        place_button = browse_button(requested, PathKind.RESULTS, self.place.setText)
        self.place_row = hbox(label("Results in"), self.place, place_button, wide=1)
        self.run_button = push_button("Classify", self._run)
        self.cancel_button = push_button("Cancel", self.cancel_requested.emit)
        self.results_button = push_button(
            "Results", self.results_requested.emit, "Show the last results again"
        )
        self.bar, self.stage = QProgressBar(), label("", "muted", wraps=True)
        self.result = label("", wraps=True)
        self._since_stage = QElapsedTimer()
        self._stage, self._first_share = "", 0.0
        self._lay_out()
        self.method.currentIndexChanged.connect(lambda _: self._show_method())
        self.form.path_requested.connect(self.path_requested)
        self._show_method()
        self.clear_result()

    def place_of(self, session: str) -> Path:
        """Return the folder for figures, reports and models of a session. Raises WrongUse."""
        return results_folder(session, self.place.text(), self.fallback())

    def show_place(self, session: str) -> None:
        """Say in the empty field where the results of a session go."""
        place = results_folder(session, "", self.fallback())
        is_beside = place == typed_path(session).absolute().parent
        self.place.setPlaceholderText(BESIDE if is_beside else str(place))

    def show_experiment(self, experiment: str) -> None:
        """Offer the methods for sessions of an experiment."""
        names = _names(experiment)
        if [self.method.itemData(i) for i in range(self.method.count())] != list(names.values()):
            self.method.clear()
            for name, key in names.items():
                self.method.addItem(name, key)
        self.form.show_experiment(experiment)

    def show_progress(self, stage: str, share: float) -> None:
        """Show the progress, 0 to 1, and the remaining time of a stage."""
        if stage != self._stage or not self._since_stage.isValid():
            self._stage, self._first_share = stage, share
            self._since_stage.start()
        gained = share - self._first_share
        left = ""
        if gained > 0 and share < 1:
            left_s = self._since_stage.elapsed() / 1000 * (1 - share) / gained
            left = f", {duration(left_s)} left"
        self.stage.setText(f"{stage}{left}")
        self.bar.setMaximum(100 if share > 0 else 0)  # of 0 % nobody knows how long it stands
        self.bar.setValue(round(100 * share))

    def show_result(self, sentence: str, *, is_alarming: bool = False) -> None:
        """Show the result of an analysis."""
        set_property(self.result, "role", "bad" if is_alarming else "")
        self.result.setText(sentence)
        self.results_button.setEnabled(True)

    def show_refusal(self, sentence: str) -> None:
        """Show why an analysis did not run or did not finish."""
        set_property(self.result, "role", "bad")
        self.result.setText(sentence)

    def clear_result(self) -> None:
        """Show no result."""
        self.result.clear()
        self.results_button.setEnabled(False)

    def show_busy(self, busy: bool, runnable: bool) -> None:
        """Show whether an analysis runs; ``runnable`` says whether one can start."""
        if busy:
            self.bar.setValue(0)
            self.result.clear()
            self._since_stage.invalidate()
        else:
            self.stage.clear()
        self.run_button.setEnabled(runnable and not busy)
        self.cancel_button.setEnabled(busy)
        for widget in (self.method, self.form, self.form.session_row, self.model_row):
            widget.setEnabled(not busy)
        self.bar.setVisible(busy)
        self.stage.setVisible(busy)

    def _show_method(self) -> None:
        key = self.method.currentData()
        if key is None:  # between two experiments
            return
        self.description.setText(METHODS[key].description)
        self.form.setVisible(key in (PAPER, REALTIME))
        self.model_row.setVisible(key == MODEL)
        self.run_button.setText(METHODS[key].button)
        self.result.clear()  # it is of another method

    def _run(self) -> None:
        method = self.method.currentData()
        if method == MODEL and not self.model.text().strip():
            self.show_refusal("No model: choose a model file, which an analysis saves.")
        elif method not in (PAPER, REALTIME) or not self.form.has_refused:
            self.run_requested.emit(method)

    def _lay_out(self) -> None:
        buttons = QHBoxLayout()
        for button in (self.run_button, self.cancel_button, self.results_button):
            buttons.addWidget(button)
        method = (self.method, self.description, self.model_row)
        # The form is long and comes last: Cancel and the bar stay visible.
        rows = (*method, self.place_row, buttons, self.stage, self.bar, self.result, self.form)
        self.setLayout(vbox(*rows, spacing=5, margins=(8, 6, 8, 8)))


def _names(experiment: str) -> dict[str, str]:
    """Return the key of each method of an experiment, by its name."""
    return {METHODS[key].name: key for key in METHODS_OF[experiment]}
