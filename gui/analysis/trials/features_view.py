"""The features of one recorded trial as images: a row for each neuron, a column per window."""

from __future__ import annotations

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QPointF

from gui.analysis.tasks.task_values import TrialFeatures
from gui.analysis.trial_view import LEAST_PX
from gui.widgets.labels import label
from gui.widgets.plot_axes import (
    PlotGrid,
    colour_axes,
    label_axis,
    reserve,
    text_width_px,
    time_plot,
    whole_ticks,
)
from gui.widgets.theme import Theme

HINT = "Point at a window to read its value"
KINDS = {"SA": "Hz", "RA": "spikes"}
"""Kind of the neurons and unit of their features."""
_SCALES = {"SA": "Rate (Hz)", "RA": "Count (spikes)"}
_SCALE_PX, _SCALE_AXIS_PX = 12, 52
_TAXEL_STEP = 4
_Ticks = list[tuple[float, str]]


class FeaturesView(PlotGrid):
    """SA and RA features with their colour scales; a line says what the pointer is on."""

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self._theme, self.heading = theme, ""
        self.features: TrialFeatures | None = None
        self.plots = [
            time_plot(self.cells, row, f"{kind} neuron", last=kind == "RA")
            for row, kind in enumerate(KINDS)
        ]
        self.images = [pg.ImageItem(axisOrder="row-major") for _ in KINDS]
        self.scales = [
            _colour_scale(plot, image) for plot, image in zip(self.plots, self.images, strict=True)
        ]
        self.plots[1].setXLink(self.plots[0])
        self.plots[1].getViewBox().sigResized.connect(lambda _: self._number_windows())
        self.value = label(HINT, "muted")
        self.value.setContentsMargins(8, 2, 8, 2)
        layout = self.layout()
        assert layout is not None
        layout.addWidget(self.value)
        self.graphics.scene().sigMouseMoved.connect(self._point_at)
        self.set_theme(theme)

    def set_theme(self, theme: Theme) -> None:
        """Apply a theme."""
        self._theme = theme
        self.colour_background(theme)
        for plot in self.plots:
            colour_axes(plot, theme)
        for scale, name in zip(self.scales, _SCALES.values(), strict=True):
            scale.axis.setLabel(name)
            colour_axes(scale, theme, ("left", "top", "right", "bottom"))
        self.reserve_plots(*LEAST_PX)
        self.show_features(self.features, self.heading)

    def show_features(self, features: TrialFeatures | None, heading: str = "") -> None:
        """Show the features of the trial that the heading names, or nothing."""
        self.features, self.heading = features, heading
        self.show_heading(self.plots[0], heading, self._theme)
        self.value.setText(HINT)
        if features is None:
            for image in self.images:
                image.clear()
            return
        n, windows = len(features.values) // 2, features.values.shape[1]
        ticks = [(taxel + 0.5, f"T{taxel + 1}") for taxel in range(0, n, _TAXEL_STEP)]
        for plot, image, scale, part in zip(
            self.plots, self.images, self.scales, (0, n), strict=True
        ):
            values = features.values[part : part + n]
            image.setImage(values, autoLevels=False)
            scale.setLevels((0.0, max(1.0, float(values.max(initial=0.0)))))
            plot.setXRange(0, windows, padding=0)
            plot.setYRange(0, n, padding=0)
            plot.getAxis("left").setTicks([ticks, []])
        count_scale = self.scales[1]
        count_scale.axis.setTicks([whole_ticks(count_scale.levels()[1]), []])
        self._number_windows()

    def value_text(self, row: int, window: int) -> str:
        """Return the value of a train (SA 1 … n, RA 1 … n) in a window, with its unit."""
        assert self.features is not None
        values = self.features.values
        n = len(values) // 2
        kind, unit = list(KINDS.items())[row // n]
        name = f"{kind} of taxel {row % n + 1}, window {window + 1}"
        return f"{name}: {values[row, window]:.4g} {unit}"

    def _number_windows(self) -> None:
        """Number the windows in their middle, as many as there is room for."""
        if (features := self.features) is None:
            return
        width_px = self.plots[1].getViewBox().width()
        ticks = window_ticks(features.values.shape[1], width_px)
        for plot in self.plots:
            plot.getAxis("bottom").setTicks([ticks, []])
        length = f"{features.window_ms} ms"
        if features.window_mm:
            length = f"{features.window_mm:g} mm of texture"
        label_axis(self.plots[1], "bottom", f"Window, {length} each", self._theme)

    def _point_at(self, place: QPointF) -> None:
        if self.features is None:
            return
        n, windows = len(self.features.values) // 2, self.features.values.shape[1]
        for number, plot in enumerate(self.plots):
            if plot.getViewBox().sceneBoundingRect().contains(place):
                at = plot.getViewBox().mapSceneToView(place)
                column, row = int(np.floor(at.x())), int(np.floor(at.y()))
                if 0 <= column < windows and 0 <= row < n:
                    self.value.setText(self.value_text(number * n + row, column))


def window_ticks(n_windows: int, width_px: float) -> _Ticks:
    """Return places and numbers of windows, 1, 2, 3 … or 1, 6, 11 … where there is less room."""
    room_px = 2 * text_width_px(f"{n_windows}")
    step = next((s for s in (1, 2, 5, 10, 20) if n_windows * room_px <= s * width_px), 50)
    return [(window + 0.5, f"{window + 1}") for window in range(0, n_windows, step)]


def _colour_scale(plot: pg.PlotItem, image: pg.ImageItem) -> pg.ColorBarItem:
    """Add an image to a plot, and the scale of its colours beside it; taxel 1 is at the top."""
    plot.invertY(True)
    plot.addItem(image)
    colours = pg.colormap.get("viridis")
    scale = pg.ColorBarItem(width=_SCALE_PX, colorMap=colours, interactive=False)
    scale.setImageItem(image, insert_in=plot)
    reserve(scale, "right", _SCALE_AXIS_PX)
    return scale
