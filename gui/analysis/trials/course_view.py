"""Force and speed of one recorded trial, with its approach."""

from __future__ import annotations

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray
from PySide6.QtCore import Qt

from gui.analysis.tasks.task_values import TrialCourse
from gui.analysis.trial_view import LEAST_PX
from gui.live.drum_course import thin_out
from gui.widgets.plot_axes import PlotGrid, colour_axes, reserve_right, time_plot
from gui.widgets.theme import Theme


class CourseView(PlotGrid):
    """Two plots over the time since the trial's first sample; dashes are what was planned.

    Of many points in view the lowest and highest of groups are drawn: STOP waits for a painting.
    """

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self._theme = theme
        self.course: TrialCourse | None = None
        self.heading = ""
        self.force_plot = time_plot(self.cells, 0, "Force (g)", last=False)
        self.speed_plot = time_plot(self.cells, 1, "Speed (mm/s)", last=True)
        self.speed_plot.setLabel("bottom", "Time since the first sample (s)")
        self.speed_plot.setXLink(self.force_plot)
        for plot in (self.force_plot, self.speed_plot):
            plot.setMouseEnabled(x=True, y=False)
        self._curves: list[pg.PlotCurveItem] = []
        self.force_plot.getViewBox().sigXRangeChanged.connect(lambda *_: self._draw())
        self.set_theme(theme)

    def set_theme(self, theme: Theme) -> None:
        """Apply a theme."""
        self._theme = theme
        self.colour_background(theme)
        for plot in (self.force_plot, self.speed_plot):
            colour_axes(plot, theme)
        self.reserve_plots(*LEAST_PX)
        reserve_right(self.cells)
        self.show_course(self.course, self.heading)

    def show_course(self, course: TrialCourse | None, heading: str = "") -> None:
        """Show the force and speed of the trial that the heading names, or nothing."""
        self.course, self.heading = course, heading
        self.show_heading(self.force_plot, heading, self._theme)
        for plot in (self.force_plot, self.speed_plot):
            plot.clear()
        self._curves = []
        if course is None:
            return
        times = np.concatenate([course.force_s, course.speed_s])
        times = times[np.isfinite(times)]
        if len(times):
            self.force_plot.setXRange(times.min(), times.max(), padding=0.01)
        theme = self._theme
        self._add(self.force_plot, course.force_g, theme.force, course.planned_g)
        self._add(self.speed_plot, course.speed_mm_s, theme.speed, course.planned_mm_s)
        self._draw()

    def _add(self, plot: pg.PlotItem, y: NDArray[np.float64], colour: str, planned: float) -> None:
        """Add an empty curve to a plot with room for these values, and what was planned."""
        self._curves.append(pg.PlotCurveItem(pen=pg.mkPen(colour, width=1), connect="finite"))
        plot.addItem(self._curves[-1])
        dashes = pg.mkPen(self._theme.set_point, width=1, style=Qt.PenStyle.DashLine)
        plot.addItem(pg.InfiniteLine(planned, angle=0, pen=dashes))
        known = y[np.isfinite(y)]
        low, high = min(0.0, known.min(initial=0.0)), max(planned, known.max(initial=0.0))
        plot.setYRange(low, high + 0.05 * (high - low or 1.0), padding=0)

    def _draw(self) -> None:
        """Draw what is in view, and a point beyond each end."""
        if self.course is None or not self._curves:
            return
        left_s, right_s = self.force_plot.getViewBox().viewRange()[0]
        course = self.course
        values = (course.force_s, course.force_g), (course.speed_s, course.speed_mm_s)
        for curve, (x, y) in zip(self._curves, values, strict=True):
            first, last = np.flatnonzero(x <= left_s)[-1:], np.flatnonzero(x >= right_s)[:1]
            part = slice(first.sum(), last.sum() + 1 if len(last) else None)
            curve.setData(*thin_out(x[part], y[part]))
