"""Classification of textures: choice of the method, its options, progress and result."""

from __future__ import annotations

from typing import NamedTuple

from PySide6.QtCore import QElapsedTimer, Signal
from PySide6.QtWidgets import QGroupBox, QHBoxLayout, QLineEdit, QProgressBar

from gui.analysis.options_form import AnalysisOptionsForm
from gui.analysis.tasks.task_values import DRUM, FINGER
from gui.widgets.file_browser import PathKind, browse_button
from gui.widgets.formatting import duration
from gui.widgets.labels import label, set_property
from gui.widgets.layouts import combo_box, container, hbox, push_button, vbox


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
        "All representations and tasks of the paper. Writes a report beside the session.",
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
        "session. Writes a report beside it.",
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
        rows = (*method, buttons, self.stage, self.bar, self.result, self.form)
        self.setLayout(vbox(*rows, spacing=5, margins=(8, 6, 8, 8)))


def _names(experiment: str) -> dict[str, str]:
    """Return the key of each method of an experiment, by its name."""
    return {METHODS[key].name: key for key in METHODS_OF[experiment]}
