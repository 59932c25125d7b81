"""The page of confusion matrices: task and representation, the matrix, and a cell in words."""

from __future__ import annotations

from collections.abc import Sequence

from PySide6.QtWidgets import QComboBox, QWidget

from gui.analysis.export.picture_file import Picture, widget_picture
from gui.analysis.figures.confusion_plot import ConfusionPlotView
from gui.analysis.figures.readout import Readout
from gui.widgets.flow_layout import FlowLayout
from gui.widgets.labels import label
from gui.widgets.layouts import combo_box, container, push_button, vbox
from gui.widgets.theme import Theme
from rigctl.analysis.report.figure import Figure, Matrix

HINT = (
    "Point at a cell to read it, or use the arrow keys; + and − zoom, 0 shows the whole matrix. "
    "A number is the share of the true texture in %."
)


class ConfusionPage(QWidget):
    """One matrix at a time."""

    def __init__(self, theme: Theme, figures: Sequence[Figure], origin: str) -> None:
        super().__init__()
        self._figures = {one.title: one for one in figures}
        self.task = combo_box({title: title for title in self._figures})
        self.task.setAccessibleName("Task")
        self.representation = combo_box({})
        self.representation.setAccessibleName("Representation")
        self.view = ConfusionPlotView(theme, figures[0].matrices[0])
        self.whole_button = push_button(
            "Whole matrix", self.view.show_whole_range, "Undo the zoom (0)"
        )
        self.name, self.words = label("", "heading", wraps=True), label("", wraps=True)
        self.readout = Readout(self.view.graphics, HINT)
        self._lay_out(origin)
        self._offer_representations()
        self.task.currentIndexChanged.connect(lambda _: self._offer_representations())
        self.representation.currentIndexChanged.connect(lambda _: self._show())
        self.view.cell_changed.connect(self.readout.show_words)

    def set_theme(self, theme: Theme) -> None:
        """Apply a theme."""
        self.view.set_theme(theme)

    def picture(self) -> Picture:
        """Return the matrix with what it is as a picture."""
        return widget_picture(self._figure)

    def _matrices(self) -> dict[str, Matrix]:
        """Return the matrices of the task by their representation."""
        return {one.name: one for one in self._figures[self.task.currentData()].matrices}

    def _offer_representations(self) -> None:
        """Offer those of the task, and keep the one that is chosen."""
        names, before = list(self._matrices()), self.representation.currentText()
        self.representation.blockSignals(True)
        self.representation.clear()
        for name in names:
            self.representation.addItem(name, name)
        self.representation.setCurrentIndex(max(self.representation.findText(before), 0))
        self.representation.blockSignals(False)
        self._show()

    def _show(self) -> None:
        matrix = self._matrices()[self.representation.currentData()]
        self.name.setText(f"{self.task.currentText()} · {matrix.title}")
        self.words.setText("; ".join(matrix.subtitle))
        if matrix is not self.view.matrix:
            self.view.show_matrix(matrix)

    def _lay_out(self, origin_words: str) -> None:
        origin = label(origin_words, "muted", wraps=True)
        column = vbox(self.name, self.words, self.view, origin, spacing=2, margins=(8, 0, 8, 0))
        column.setStretch(2, 1)
        self._figure = container(column)
        for box in (self.task, self.representation):
            box.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToContents)
        boxes = (self.task, self.representation, self.whole_button)
        head = FlowLayout(*boxes, margins=(8, 6, 8, 2))
        rows = vbox(head, self._figure, self.readout)
        rows.setStretch(1, 1)
        self.setLayout(rows)
