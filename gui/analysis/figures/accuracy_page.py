"""The page of accuracy curves: choice of the task, legend, plots, and the chosen point in words."""

from __future__ import annotations

from PySide6.QtWidgets import QCheckBox, QWidget

from gui.analysis.export.picture_file import Picture, widget_picture
from gui.analysis.figures.accuracy import AccuracyPlot
from gui.analysis.figures.accuracy_plots import ROW_PX, AccuracyPlots
from gui.analysis.figures.curve_looks import LOOKS, SAMPLE
from gui.analysis.figures.readout import Readout
from gui.widgets.flow_layout import FlowLayout
from gui.widgets.labels import label
from gui.widgets.layouts import combo_box, container, hbox, push_button, scroll_area, vbox
from gui.widgets.theme import Theme

HINT = (
    "Point at a curve to read it, or use the keys: left and right for the components, up and down "
    "for the curve, Page up and Page down for the task, + and − to zoom, 0 for the whole range."
)


class AccuracyPage(QWidget):
    """Curves that the legend switches on and off."""

    def __init__(self, theme: Theme, plot: AccuracyPlot) -> None:
        super().__init__()
        self.plots = AccuracyPlots(theme, plot)
        titles = {panel.title: f"{number}" for number, panel in enumerate(plot.panels)}
        self.task = combo_box({"All tasks": "", **titles} if len(titles) > 1 else titles)
        self.task.setAccessibleName("Task")
        self.whole_button = push_button(
            "Whole range", self.plots.show_whole_range, "Undo the zoom (0)"
        )
        self.readout = Readout(self.plots.graphics, HINT)
        self.legend = {key: QCheckBox(name) for key, name in plot.curves().items()}
        self._lay_out(plot)
        self.set_theme(theme)
        self.task.currentIndexChanged.connect(lambda _: self._show_task())
        self.plots.point_changed.connect(self._show_point)
        for box in self.legend.values():
            box.toggled.connect(lambda _: self._hide_curves())

    def set_theme(self, theme: Theme) -> None:
        """Apply a theme."""
        self.plots.set_theme(theme)
        for key, box in self.legend.items():
            box.setIcon(LOOKS[key].sample(theme))

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
        hidden = frozenset(key for key, box in self.legend.items() if not box.isChecked())
        self.plots.hide_curves(hidden)

    def _lay_out(self, plot: AccuracyPlot) -> None:
        for box in self.legend.values():
            box.setChecked(True)
            box.setIconSize(SAMPLE)
            box.setToolTip("Show or hide this curve")
        origin = label(_marks(plot), "muted", wraps=True)
        column = vbox(FlowLayout(*self.legend.values()), self.plots, origin, spacing=2)
        column.setContentsMargins(8, 0, 8, 0)
        column.setStretch(1, 1)
        self._figure = container(column)
        head = hbox(self.task, self.whole_button, margins=(8, 6, 8, 2))
        self._area = scroll_area(self._figure)
        rows = vbox(head, self._area, self.readout)
        rows.setStretch(1, 1)
        self.setLayout(rows)


def _marks(plot: AccuracyPlot) -> str:
    """Return what bars, marks and dots are, as far as there are any, and where data come from."""
    has_bars = plot.panels[0].curves[0].spread
    bars = f"Bars: {plot.panels[0].spread_name}. " if has_bars else ""
    has_paper = any(curve.paper for panel in plot.panels for curve in panel.curves)
    paper = "◆: the paper's value. " if has_paper else ""
    return f"{bars}{paper}Dotted: chance. {plot.origin}"
