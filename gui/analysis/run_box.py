"""Telling textures apart: which way, with what options, how far it is, what came out."""

from __future__ import annotations

from PySide6.QtCore import QElapsedTimer, Signal
from PySide6.QtWidgets import (
    QGroupBox,
    QHBoxLayout,
    QLineEdit,
    QProgressBar,
    QPushButton,
    QVBoxLayout,
    QWidget,
)

from gui.analysis.options_form import AnalysisOptionsForm, beside, chooser, small
from gui.widgets.formatting import duration
from gui.widgets.labels import label

QUICK, PAPER, MODEL = "quick", "paper", "model"
WAYS = {"Quick check": QUICK, "The paper's analysis": PAPER, "A trained model": MODEL}
HINTS = {
    QUICK: "PCA and LDA on speed-scaled features, tested on trials held out from training.",
    PAPER: "All representations and tasks of the paper; a report beside the session.",
    MODEL: "Ask a model that an analysis kept; the answers appear at the right.",
}
RUN_WORDS = {QUICK: "Classify", PAPER: "Analyse", MODEL: "Ask"}


class AnalysisRunBox(QGroupBox):
    """``run_asked``: with the way that is chosen."""

    run_asked = Signal(str)
    cancel_asked = Signal()
    results_asked = Signal()
    model_asked = Signal()

    def __init__(self) -> None:
        super().__init__("Tell textures apart")
        self.way, self.hint = chooser(WAYS), label("", "muted", wraps=True)
        self.form = AnalysisOptionsForm()
        self.model = QLineEdit()
        self.model.setPlaceholderText("A model file")
        self.browse_model = small("…", "Choose a model file")
        self.model_row = QWidget()
        self.run, self.cancel = QPushButton("Classify"), QPushButton("Cancel")
        self.results = QPushButton("Results")
        self.results.setToolTip("Show the last results again")
        self.bar, self.stage = QProgressBar(), label("", "muted", wraps=True)
        self.answer = label("", wraps=True)
        self._since = QElapsedTimer()
        self._stage, self._first_share = "", 0.0
        self._lay_out()
        self._connect()
        self._choose()

    def show_progress(self, stage: str, share: float) -> None:
        """How far the work is, and how long this stage still takes."""
        if stage != self._stage or not self._since.isValid():
            self._stage, self._first_share = stage, share
            self._since.start()
        gained = share - self._first_share
        left = ""
        if gained > 0 and share < 1:
            left_s = self._since.elapsed() / 1000 * (1 - share) / gained
            left = f", {duration(left_s)} left"
        self.stage.setText(f"{stage}{left}")
        self.bar.setValue(round(100 * share))

    def show_busy(self, busy: bool, runnable: bool) -> None:
        """Whether something is going; ``runnable``: there is something to run on."""
        if busy:
            self.bar.setValue(0)
            self._since.invalidate()
        else:
            self.stage.clear()
        self.run.setEnabled(runnable and not busy)
        self.cancel.setEnabled(busy)
        for widget in (self.way, self.form, self.model_row):
            widget.setEnabled(not busy)
        self.bar.setVisible(busy)
        self.stage.setVisible(busy)

    def _choose(self) -> None:
        way = self.way.currentData()
        self.hint.setText(HINTS[way])
        self.form.setVisible(way == PAPER)
        self.model_row.setVisible(way == MODEL)
        self.run.setText(RUN_WORDS[way])

    def _connect(self) -> None:
        self.way.currentIndexChanged.connect(lambda _: self._choose())
        self.run.clicked.connect(lambda: self.run_asked.emit(self.way.currentData()))
        self.cancel.clicked.connect(self.cancel_asked)
        self.results.clicked.connect(self.results_asked)
        self.browse_model.clicked.connect(self.model_asked)

    def _lay_out(self) -> None:
        column = QVBoxLayout(self)
        column.setContentsMargins(8, 6, 8, 8)
        column.setSpacing(5)
        row = beside(self.model, self.browse_model)
        row.setContentsMargins(0, 0, 0, 0)
        self.model_row.setLayout(row)
        for widget in (self.way, self.hint, self.model_row):
            column.addWidget(widget)
        buttons = QHBoxLayout()
        for button in (self.run, self.cancel, self.results):
            buttons.addWidget(button)
        column.addLayout(buttons)
        # The form is long and comes last: Cancel and the bar stay in sight.
        for widget in (self.stage, self.bar, self.answer, self.form):
            column.addWidget(widget)
