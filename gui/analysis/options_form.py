"""What an analysis can be told: a form with the options of ``rigctl analyse``."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtCore import Signal
from PySide6.QtWidgets import (
    QCheckBox,
    QComboBox,
    QDoubleSpinBox,
    QFormLayout,
    QHBoxLayout,
    QLineEdit,
    QPushButton,
    QSpinBox,
    QWidget,
)

from gui.analysis.results import AnalysisRequest, model_path
from gui.widgets.labels import elastic, label, show_text
from rigctl.encoding.parameters import PRESETS

TASKS = {
    "All that fit": "",
    "Individual textures": "textures",
    "Texture groups": "groups",
    "Extrapolation (3C–F)": "extrapolation",
    "Each speed left out": "leave-speed-out",
    "Each force left out": "leave-force-out",
}
ENGINES = {"Own (fast)": "own", "scikit-learn": "sklearn"}
REPRESENTATIONS = {
    "Original": "original",
    "Speed Scaled": "speed",
    "Force Scaled": "force",
    "Speed and Force Scaled": "speed_force",
    "Force Scaled, texture-blind": "force_blind",
    "Speed and Force Scaled, texture-blind": "speed_force_blind",
}
MAX_SEED = 2**31 - 1


class AnalysisOptionsForm(QWidget):
    """The choices; :meth:`order` says them. The session that is open is always among them."""

    session_asked = Signal()
    c_asked = Signal()

    def __init__(self) -> None:
        super().__init__()
        self.sessions = elastic(label("–"))
        self.add, self.forget = small("+", "Add another session"), small("−", "Only the open one")
        self.task, self.engine = chooser(TASKS), chooser(ENGINES)
        self.draws, self.components = number(1, 10_000, 20), number(1, 1000, 50)
        self.preset = chooser({name: name for name in PRESETS})
        self.reference = QDoubleSpinBox()
        self.reference.setRange(0.0, 1e6)
        self.reference.setDecimals(1)
        self.reference.setValue(500.0)
        self.reference.setSuffix(" g")
        self.reference.setToolTip("The force whose SA rates the others are scaled to")
        self.seed = number(0, MAX_SEED, 0)
        self.sensitivity = QCheckBox("Try all encoder presets")
        self.model = chooser({"None": "", **REPRESENTATIONS})
        self.model.setToolTip("Learnt from all trials and kept beside the report")
        self.c = QLineEdit()
        self.c.setPlaceholderText("searched")
        self.c.setToolTip("A model file that C is taken from; its rate error is measured")
        self.browse_c = small("…", "Choose a model file")
        self._open = ""
        self._more: list[str] = []
        self._lay_out()
        self._connect()

    def show_session(self, path: str) -> None:
        """Another session is open."""
        self._open = path
        self._more = [more for more in self._more if more != path]
        self._show_sessions()

    def add_session(self, path: str) -> None:
        """Analyse this folder together with the open one."""
        if path not in self.chosen:
            self._more.append(path)
        self._show_sessions()

    @property
    def chosen(self) -> tuple[str, ...]:
        """The sessions, the open one first."""
        return (*((self._open,) if self._open else ()), *self._more)

    def order(self) -> AnalysisRequest:
        """Everything as it is chosen, with a new folder beside the open session."""
        return AnalysisRequest(
            sessions=self.chosen,
            folder=str(_new_folder(Path(self._open))),
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
        )

    def _show_sessions(self) -> None:
        show_text(self.sessions, ", ".join(Path(path).name for path in self.chosen) or "–")
        self.sessions.setToolTip("\n".join(self.chosen))
        self.forget.setEnabled(bool(self._more))

    def _forget(self) -> None:
        self._more.clear()
        self._show_sessions()

    def _connect(self) -> None:
        self.add.clicked.connect(self.session_asked)
        self.forget.clicked.connect(self._forget)
        self.browse_c.clicked.connect(self.c_asked)

    def _lay_out(self) -> None:
        form = QFormLayout(self)
        form.setContentsMargins(0, 0, 0, 0)
        form.setVerticalSpacing(4)
        form.setFieldGrowthPolicy(QFormLayout.FieldGrowthPolicy.ExpandingFieldsGrow)
        form.addRow("Sessions", beside(self.sessions, self.add, self.forget))
        for name, widget in (
            ("Tasks", self.task),
            ("Draws", self.draws),
            ("Components", self.components),
            ("Encoder", self.preset),
            ("Reference", self.reference),
            ("Seed", self.seed),
            ("Engine", self.engine),
        ):
            form.addRow(name, widget)
        form.addRow("C from", beside(self.c, self.browse_c))
        form.addRow("Keep model", self.model)
        form.addRow(self.sensitivity)
        self._show_sessions()


def _new_folder(session: Path) -> Path:
    """A name that is free: the session's with a number behind it."""
    count = 1
    while True:
        folder = session.with_name(f"{session.name}-report-{count}")
        if not folder.exists() and not model_path(folder).exists():
            return folder
        count += 1


def chooser(items: dict[str, str]) -> QComboBox:
    """A list that may be narrower than its longest item; ``items``: what it says, what it means."""
    made = QComboBox()
    for text, data in items.items():
        made.addItem(text, data)
    made.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon)
    made.setMinimumContentsLength(8)
    return made


def number(low: int, high: int, value: int) -> QSpinBox:
    """A whole number."""
    made = QSpinBox()
    made.setRange(low, high)
    made.setValue(value)
    return made


def small(text: str, hint: str) -> QPushButton:
    """A button of one sign."""
    made = QPushButton(text)
    made.setFixedWidth(34)
    made.setToolTip(hint)
    return made


def beside(wide: QWidget, *narrow: QWidget) -> QHBoxLayout:
    """A row."""
    row = QHBoxLayout()
    row.setSpacing(4)
    row.addWidget(wide, 1)
    for widget in narrow:
        row.addWidget(widget)
    return row
