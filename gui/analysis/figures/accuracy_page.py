"""The page of a figure of curves: choice of a plot, legend, and the chosen point in words."""

from __future__ import annotations

from PySide6.QtWidgets import QCheckBox, QWidget

from gui.analysis.export.picture_file import Picture, widget_picture
from gui.analysis.figures.accuracy_plots import ROW_PX, AccuracyPlots
from gui.analysis.figures.curve_looks import SAMPLE, look_of
from gui.analysis.figures.readout import Readout
from gui.widgets.flow_layout import FlowLayout
from gui.widgets.labels import label
from gui.widgets.layouts import combo_box, container, hbox, push_button, scroll_area, vbox
from gui.widgets.theme import Theme
from rigctl.analysis.report.figure import Figure

HINT = (
    "Point at a curve to read it, or use the keys: left and right along it, up and down "
    "for the curve, Page up and Page down for the plot, + and − to zoom, 0 for the whole range."
)


class AccuracyPage(QWidget):
    """Curves that the legend switches on and off."""

    def __init__(self, theme: Theme, figure: Figure, origin: str) -> None:
        super().__init__()
        self.plots = AccuracyPlots(theme, figure)
        titles = {panel.title: f"{number}" for number, panel in enumerate(figure.plots)}
        self.task = combo_box({"All plots": "", **titles} if len(titles) > 1 else titles)
        self.task.setAccessibleName("Plot")
        self.whole_button = push_button(
            "Whole range", self.plots.show_whole_range, "Undo the zoom (0)"
        )
        self.readout = Readout(self.plots.graphics, HINT)
        self.legend = {name: QCheckBox(name) for name in figure.legend}
        self._curves = figure.legend
        self._lay_out(f"{_marks(figure)} {origin}")
        self.set_theme(theme)
        self.task.currentIndexChanged.connect(lambda _: self._show_task())
        self.plots.point_changed.connect(self._show_point)
        for box in self.legend.values():
            box.toggled.connect(lambda _: self._hide_curves())

    def set_theme(self, theme: Theme) -> None:
        """Apply a theme."""
        self.plots.set_theme(theme)
        for name, box in self.legend.items():
            box.setIcon(look_of(self._curves[name]).sample(theme))

    def picture(self) -> Picture:
        """Return legend, plots and origin as a picture."""
        self.plots.make_all()
        return widget_picture(self._figure)

    def _show_task(self) -> None:
        number = self.task.currentData()
        self.plots.show_alone(int(number) if number else None)

    def _show_point(self, words: str) -> None:
        """Say what the point is, and scroll to its plot."""
        self.readout.show_words(words)
        if (place := self.plots.chosen_place()) is not None:
            at = self.plots.mapTo(self._figure, place)
            self._area.ensureVisible(at.x(), at.y(), 0, ROW_PX // 2)

    def _hide_curves(self) -> None:
        hidden = frozenset(name for name, box in self.legend.items() if not box.isChecked())
        self.plots.hide_curves(hidden)

    def _lay_out(self, notes: str) -> None:
        for box in self.legend.values():
            box.setChecked(True)
            box.setIconSize(SAMPLE)
            box.setToolTip("Show or hide this curve")
        origin = label(notes, "muted", wraps=True)
        column = vbox(FlowLayout(*self.legend.values()), self.plots, origin, spacing=2)
        column.setContentsMargins(8, 0, 8, 0)
        column.setStretch(1, 1)
        self._figure = container(column)
        head = hbox(self.task, self.whole_button, margins=(8, 6, 8, 2))
        self._area = scroll_area(self._figure)
        rows = vbox(head, self._area, self.readout)
        rows.setStretch(1, 1)
        self.setLayout(rows)


def _marks(figure: Figure) -> str:
    """Return what bars, marks and dots are, as far as there are any."""
    has_paper = any(curve.published for panel in figure.plots for curve in panel.series)
    paper = ["◆: the paper's value."] if has_paper else []
    dotted = {panel.level[1].partition(" ")[0] for panel in figure.plots if panel.level}
    return " ".join([*figure.notes[:1], *paper, *(f"Dotted: {what}." for what in sorted(dotted))])
