"""Force and speed of the drum against time, each with its set-point."""

from __future__ import annotations

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray

from gui.theme import Theme

_HEADROOM = 1.15
_NICE = (50, 100, 150, 200, 300, 400, 600, 800, 1200, 1600, 2000, 3000)


class SetPointPlot:
    """A measured quantity over its set-point; the scale moves in round steps only."""

    def __init__(self, plot: pg.PlotItem, colour_of: str, theme: Theme) -> None:
        self._plot = plot
        self._colour_of = colour_of
        self._set_point = pg.PlotCurveItem(skipFiniteCheck=True)
        self._measured = pg.PlotCurveItem(skipFiniteCheck=True)
        plot.addItem(self._set_point)
        plot.addItem(self._measured)
        self._top = 0.0
        self._scale(0.0)
        self.set_theme(theme)

    def set_theme(self, theme: Theme) -> None:
        """Draw in other colours."""
        self._set_point.setPen(pg.mkPen(theme.set_point, width=1))
        self._measured.setPen(pg.mkPen(getattr(theme, self._colour_of), width=1))

    def refresh(
        self,
        ago_s: NDArray[np.float64],
        measured: NDArray[np.float64],
        set_point: NDArray[np.float64],
    ) -> None:
        """Show (n,) values at ``ago_s`` (negative, newest last)."""
        self._measured.setData(ago_s, measured)
        self._set_point.setData(ago_s, set_point)
        if len(ago_s):
            self._scale(float(max(measured.max(), set_point.max())))

    def _scale(self, highest: float) -> None:
        wanted = highest * _HEADROOM
        top = float(next((nice for nice in _NICE if nice >= wanted), wanted))
        if top != self._top:
            self._top = top
            self._plot.setYRange(-0.04 * top, 1.04 * top, padding=0)
            ticks = [(value, f"{value:.0f}") for value in (0.0, top / 2, top)]
            self._plot.getAxis("left").setTicks([ticks, []])
