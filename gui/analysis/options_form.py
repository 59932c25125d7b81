"""A form with the options of ``rigctl analyse``."""

from __future__ import annotations

from itertools import count
from pathlib import Path

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QCheckBox, QLineEdit, QWidget

from gui.analysis.tasks.task_values import DRUM, FINGER, AnalysisRequest, model_path
from gui.widgets.file_browser import PathKind, browse_button
from gui.widgets.labels import label, plain_tooltip, show_text
from gui.widgets.layouts import combo_box, container, form_layout, hbox, push_button, vbox
from gui.widgets.number_box import NumberBox, WholeNumberBox, has_refused
from rigctl.encoding.parameters import PRESETS

TASKS = {
    "All that fit the sessions": "",
    "Individual textures": "textures",
    "Texture groups": "groups",
    "Extrapolation (Fig. 3C–F)": "extrapolation",
    "Leave one speed out": "leave-speed-out",
    "Leave one force out": "leave-force-out",
    "Leave one mounting out": "leave-mount-out",
}
ENGINES = {"rigctl's own (fast)": "own", "scikit-learn (slow)": "sklearn"}
REPRESENTATIONS = {
    "Original": "original",
    "Speed Scaled": "speed",
    "Force Scaled": "force",
    "Speed and Force Scaled": "speed_force",
    "Force Scaled, texture-blind": "force_blind",
    "Speed and Force Scaled, texture-blind": "speed_force_blind",
}
MAX_SEED = 2**31 - 1
DRAWS = {DRUM: 20, FINGER: 100}
"""The paper's number of draws in each experiment."""


class AnalysisOptionsForm(QWidget):
    """The sessions and options of an analysis; the open session is always the first one.

    ``session_row`` names the sessions; the panel shows it above their trials.
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
        self.task, self.engine = combo_box(TASKS), combo_box(ENGINES)
        self.draws = WholeNumberBox(minimum=1, maximum=10_000, value=DRAWS[DRUM])
        self.components = WholeNumberBox(minimum=1, maximum=1000, value=50)
        self.draws.setToolTip("Number of random splits into training and test trials")
        self.components.setToolTip("Largest number of principal components")
        self.preset = combo_box({name: name for name in PRESETS})
        self.reference = NumberBox(decimals=1, maximum=1e6, value=500.0, suffix=" g")
        self.reference.setToolTip("Force to which the SA rates of the other forces are scaled")
        self.seed = WholeNumberBox(maximum=MAX_SEED)
        self.seed.setToolTip("Seed of the draws")
        self.sensitivity = QCheckBox("Compare all encoder presets")
        self.model = combo_box({"None": "", **REPRESENTATIONS})
        self._model_row = container(vbox(label("Save model"), self.model))
        self.model.setToolTip("Representation of a model that is trained on all trials")
        self.c = QLineEdit(placeholderText="found by a search")
        self.c.setToolTip("Model file that C is taken from; the analysis measures its rate error")
        self.c_button = browse_button(requested, PathKind.MODEL, self.c.setText)
        self.settings = QLineEdit(placeholderText="the paper's")
        self.settings.setToolTip(
            "Analysis file with other conditions, groups, shares, windows and reference force"
        )
        self.settings_button = browse_button(
            requested, PathKind.ANALYSIS_FILE, self.settings.setText
        )
        self.settings.textChanged.connect(self._show_reference)
        self._experiment = DRUM
        self._open_session = ""
        self._added: list[str] = []
        # A list that is too long for the place beside its name stands below it.
        self.task.setMinimumContentsLength(max(map(len, TASKS)))
        self._lay_out()

    def show_experiment(self, experiment: str) -> None:
        """Show the options of an experiment's analysis, with its usual number of draws."""
        if experiment == self._experiment:
            return
        self._experiment = experiment
        self.draws.setValue(DRAWS[experiment])
        for field in self._drum_fields:
            self._form.setRowVisible(field, experiment == DRUM)

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
        fields = (self.draws, self.components, self.reference, self.seed)
        return has_refused(*(field for field in fields if field.isVisible()))

    def request(self) -> AnalysisRequest:
        """Return the chosen options, with a new folder beside the open session."""
        return AnalysisRequest(
            sessions=self.sessions,
            folder=str(_new_folder(Path(self._open_session))),
            task=self.task.currentData(),
            draws=self.draws.value(),
            components=self.components.value(),
            engine=self.engine.currentData(),
            preset=self.preset.currentData(),
            reference_g=self.reference.value(),
            seed=self.seed.value(),
            sensitivity=self.sensitivity.isChecked(),
            representation=self.model.currentData(),
            c=self.c.text().strip(),
            settings=self.settings.text().strip(),
        )

    def _show_sessions(self) -> None:
        names = ", ".join(Path(path).name for path in self.sessions)
        show_text(self.session_names, names or "–")
        self.session_names.setToolTip(plain_tooltip("\n".join(self.sessions)))
        self.add_button.setEnabled(bool(self._open_session))
        self.remove_button.setEnabled(bool(self._added))

    def _show_reference(self, settings: str) -> None:
        """Let the reference force be chosen only where no analysis file says it."""
        self.reference.setEnabled(not settings.strip())

    def _remove_added(self) -> None:
        self._added.clear()
        self._show_sessions()
        self.sessions_changed.emit(self.sessions)

    def _lay_out(self) -> None:
        self._form = form = form_layout(4)
        self.setLayout(form)
        form.addRow("Tasks", self.task)
        form.addRow("Constants", hbox(self.settings, self.settings_button))
        form.addRow("Draws", self.draws)
        form.addRow("Components", self.components)
        form.addRow("Encoder", self.preset)
        form.addRow("Reference force", self.reference)
        form.addRow("Seed", self.seed)
        form.addRow("Engine", self.engine)
        c_row = hbox(self.c, self.c_button)
        form.addRow("C from", c_row)
        form.addRow(self._model_row)
        form.addRow(self.sensitivity)
        self._drum_fields = (
            self.task, self.components, self.preset, self.reference, c_row, self._model_row,
            self.sensitivity,
        )  # fmt: skip
        self._show_sessions()


def _new_folder(session: Path) -> Path:
    """Return a new folder for a report beside the session; its name ends in a number."""
    folders = (session.with_name(f"{session.name}-report-{number}") for number in count(1))
    return next(f for f in folders if not f.exists() and not model_path(f).exists())
