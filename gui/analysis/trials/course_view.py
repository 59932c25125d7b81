"""Force and speed of one recorded trial, with its approach."""

from __future__ import annotations

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray
from PySide6.QtCore import Qt

from gui.analysis.tasks.task_values import TrialCourse
from gui.analysis.trial_view import LEAST_PX
from gui.widgets.plots.plot_axes import colour_axes, reserve_right, time_plot
from gui.widgets.plots.plot_grid import PlotGrid
from gui.widgets.theme import Theme


class CourseView(PlotGrid):
    """Two plots over the time since the trial's first sample; dashes are what was planned."""

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
        if course is None:
            return
        theme = self._theme
        self._draw(self.force_plot, course.force_s, course.force_g, theme.force, course.planned_g)
        speed = course.speed_mm_s
        self._draw(self.speed_plot, course.speed_s, speed, theme.speed, course.planned_mm_s)
        times = np.concatenate([course.force_s, course.speed_s])
        times = times[np.isfinite(times)]
        if len(times):
            self.force_plot.setXRange(times.min(), times.max(), padding=0.01)

    def _draw(
        self,
        plot: pg.PlotItem,
        x: NDArray[np.float64],
        y: NDArray[np.float64],
        colour: str,
        planned: float,
    ) -> None:
        plot.addItem(pg.PlotCurveItem(x, y, pen=pg.mkPen(colour, width=1), connect="finite"))
        dashes = pg.mkPen(self._theme.set_point, width=1, style=Qt.PenStyle.DashLine)
        plot.addItem(pg.InfiniteLine(planned, angle=0, pen=dashes))
        known = y[np.isfinite(y)]
        low, high = min(0.0, known.min(initial=0.0)), max(planned, known.max(initial=0.0))
        plot.setYRange(low, high + 0.05 * (high - low or 1.0), padding=0)
