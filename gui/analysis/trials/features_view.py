"""The features of one recorded trial as an image: a row for each neuron, a column per window."""

from __future__ import annotations

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QPointF

from gui.analysis.tasks.task_values import TrialFeatures
from gui.analysis.trial_view import LEAST_PX
from gui.widgets.plots.plot_axes import colour_axes, label_axis, time_plot, title_plot
from gui.widgets.plots.plot_grid import PlotGrid
from gui.widgets.theme import Theme

HINT = "Point at a window to read its value"


class FeaturesView(PlotGrid):
    """SA and RA features; the title says what the pointer is on."""

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self._theme = theme
        self.features: TrialFeatures | None = None
        self.plots = [
            time_plot(self.cells, row, f"{kind} neuron", last=bool(row))
            for row, kind in enumerate(("SA", "RA"))
        ]
        self.images = [pg.ImageItem(axisOrder="row-major") for _ in self.plots]
        for plot, image in zip(self.plots, self.images, strict=True):
            plot.addItem(image)
            image.setColorMap(pg.colormap.get("viridis"))
        self.plots[1].setXLink(self.plots[0])
        self.graphics.scene().sigMouseMoved.connect(self._point_at)
        self.set_theme(theme)

    def set_theme(self, theme: Theme) -> None:
        """Apply a theme."""
        self._theme = theme
        self.colour_background(theme)
        for plot in self.plots:
            colour_axes(plot, theme)
        self.reserve_plots(*LEAST_PX)
        self._show_text(HINT)

    def show_features(self, features: TrialFeatures | None) -> None:
        """Show the features of a trial, or nothing."""
        self.features = features
        self._show_text(HINT)
        if features is None:
            for image in self.images:
                image.clear()
            return
        n = len(features.values) // 2
        for plot, image, part in zip(self.plots, self.images, (0, n), strict=True):
            image.setImage(features.values[part : part + n], autoLevels=True)
            plot.setXRange(0, features.values.shape[1], padding=0)
            plot.setYRange(0, n, padding=0)
            ticks = [(taxel + 0.5, f"{taxel + 1}") for taxel in range(0, n, 4)]
            plot.getAxis("left").setTicks([ticks, []])
        window = f"{features.window_mm:g} mm" if features.window_mm else f"{features.window_ms} ms"
        label_axis(self.plots[1], "bottom", f"Window of {window}", self._theme)

    def value_text(self, row: int, window: int) -> str:
        """Return the value of a train (SA 1 … n, RA 1 … n) in a window, with its unit."""
        assert self.features is not None
        values = self.features.values
        is_sa, n = row < len(values) // 2, len(values) // 2
        kind, unit = ("SA", "Hz") if is_sa else ("RA", "spikes")
        name = f"{kind} of taxel {row % n + 1}, window {window + 1}"
        return f"{name}: {values[row, window]:.4g} {unit}"

    def _point_at(self, place: QPointF) -> None:
        if self.features is None:
            return
        n, windows = len(self.features.values) // 2, self.features.values.shape[1]
        for number, plot in enumerate(self.plots):
            if plot.sceneBoundingRect().contains(place):
                at = plot.getViewBox().mapSceneToView(place)
                column, row = int(np.floor(at.x())), int(np.floor(at.y()))
                if 0 <= column < windows and 0 <= row < n:
                    self._show_text(self.value_text(number * n + row, column))

    def _show_text(self, text: str) -> None:
        title_plot(self.plots[0], text, self._theme.muted, 10.0)
