"""The learning curve as a plot: accuracy with its interval, and chance."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QEvent, QPointF

from gui.protocol.learning.curve_texts import point_text
from gui.widgets.plots.plot_axes import (
    LEFT_PX,
    colour_axes,
    fixed_plot,
    reserve,
    reserve_right,
    title_plot,
    whole_ticks,
)
from gui.widgets.plots.plot_grid import PlotGrid
from gui.widgets.theme import applied_theme, scaled_px

if TYPE_CHECKING:
    from rigctl.analysis.learning.learning_curve import CurvePoint

HINT = "Point at the curve to read its values"
LOWEST_PX = 182
PERCENT_TICKS = range(0, 101, 20)


_NEW_LOOKS = (QEvent.Type.PaletteChange, QEvent.Type.FontChange)


class CurveView(PlotGrid):
    """Draws the points; the title says what the pointer is nearest to."""

    def __init__(self) -> None:
        super().__init__()
        self.points: tuple[CurvePoint, ...] = ()
        self.title = HINT
        self.plot = fixed_plot(self.cells, 0, 0)
        self.plot.setLabel("left", "Accuracy (%)")
        self.plot.setLabel("bottom", "Trials of each plate, speed and force")
        reserve(self.plot, "left", LEFT_PX)
        self.plot.getAxis("left").setTicks([[(value, f"{value}") for value in PERCENT_TICKS], []])
        self.plot.setYRange(-4, 106, padding=0)
        self.plot.setXRange(0, 10, padding=0)
        self.plot.showGrid(y=True, alpha=0.15)
        self.graphics.scene().sigMouseMoved.connect(self._point_at)
        self.show_points(())

    def show_points(self, points: tuple[CurvePoint, ...]) -> None:
        """Draw points, or an empty plot without any."""
        self.points = points
        theme = applied_theme()
        self.colour_background(theme)
        colour_axes(self.plot, theme)
        reserve_right(self.cells)
        self.graphics.setMinimumHeight(scaled_px(LOWEST_PX))
        self.plot.clear()
        self._show_title(HINT if points else "")
        if not points:
            return
        x = np.array([point.n_trials for point in points], float)
        y, low, high, chance = (
            100 * np.array([getattr(point, name) for point in points])
            for name in ("accuracy", "low", "high", "chance")
        )
        end = 1.05 * float(x[-1])
        self.plot.setXRange(0, end, padding=0)
        self.plot.getAxis("bottom").setTicks([whole_ticks(end), []])
        width = 0.012 * float(x[-1])
        bars = pg.ErrorBarItem(
            x=x, y=y, top=high - y, bottom=y - low, beam=width, pen=pg.mkPen(theme.accent, width=1)
        )
        dashes = pg.mkPen(theme.muted, width=1, dash=[4, 3])
        line = pg.mkPen(theme.accent, width=2)
        self.plot.addItem(bars)
        self.plot.addItem(pg.PlotDataItem(x, chance, pen=dashes))
        symbols = {"symbol": "o", "symbolSize": 7, "symbolBrush": theme.accent, "symbolPen": None}
        self.plot.addItem(pg.PlotDataItem(x, y, pen=line, **symbols))
        self._name_chance(float(x[-1]), float(chance[-1]))

    def changeEvent(self, event: QEvent) -> None:
        """Draw in the colours of another theme."""
        super().changeEvent(event)
        if event.type() in _NEW_LOOKS and hasattr(self, "plot"):
            self.show_points(self.points)

    def _name_chance(self, x: float, chance: float) -> None:
        name = pg.TextItem("chance", color=applied_theme().muted, anchor=(1, 1))
        self.plot.addItem(name)
        name.setPos(x, chance)

    def _point_at(self, place: QPointF) -> None:
        if not self.points or not self.plot.sceneBoundingRect().contains(place):
            return
        at = self.plot.getViewBox().mapSceneToView(place).x()
        self._show_title(point_text(min(self.points, key=lambda point: abs(point.n_trials - at))))

    def _show_title(self, text: str) -> None:
        self.title = text
        title_plot(self.plot, text, applied_theme().muted)
