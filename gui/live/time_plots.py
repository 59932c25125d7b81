"""Force, speed, traces and raster over one time axis, with marks and cursors over them."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray
from PySide6.QtCore import QRectF

from gui.live.force_speed import SetPointPlot
from gui.live.review.overlay import MarkLine, Overlay
from gui.live.scrolling_image import ScrollingImage
from gui.live.spikes.raster import Raster
from gui.live.spikes.train_rows import TrainRows
from gui.live.store.drum_course import DrumCourse
from gui.live.store.time_window import TimeWindow
from gui.live.store.timeline import Timeline
from gui.live.traces import Traces
from gui.live.value_scale import ValueScale
from gui.widgets.plots.plot_axes import (
    LEFT_PX,
    MAX_TICKS,
    colour_axes,
    label_axis,
    most_ticks,
    text_width_px,
    time_plot,
    time_ticks,
)
from gui.widgets.theme import Theme, scaled_px
from rigctl.session.format.metadata.sensor_layout import SensorLayout

_ROW_LABEL_PX, _TAXEL_LABEL_PX = 10, 14
_ROW_PX, _LAST_ROW_PX, _LONG_LABEL_PX = 48, 88, 84
OWN_RANGE = "Taxels<br>(own range)"
_ROW_STRETCH = (2, 2, 5, 6)
_LEAST_WIDTH_PX = 120
NOW, PAUSED = "Time relative to now (s)", "Time relative to the pause (s)"
SINCE_START, IN_TRIAL = "Time since the trial began (s)", "Time in the trial (s)"
_SHORT_CAPTIONS = {
    NOW: "s from now",
    PAUSED: "s from the pause",
    SINCE_START: "s in the trial",
    IN_TRIAL: "s in the trial",
}
"""What stands below an axis that is too narrow for its caption."""


class TimePlots:
    """The four plots in the left column of a layout."""

    def __init__(self, layout: pg.GraphicsLayout, theme: Theme, sensor: SensorLayout) -> None:
        labels = ("Force<br>(g)", "Speed<br>(mm/s)", OWN_RANGE, "Spikes")
        self.plots = [
            time_plot(layout, row, label, last=row == 3) for row, label in enumerate(labels)
        ]
        self._theme, self._scale, self._caption = theme, ValueScale(), NOW
        self._sensor, self._taxels = sensor, tuple(range(sensor.n_taxels))
        force_plot, speed_plot, self.trace_plot, self.raster_plot = self.plots
        for plot in self.plots[1:]:
            plot.setXLink(force_plot)
        self.force = SetPointPlot(force_plot, "force", theme)
        self.speed = SetPointPlot(speed_plot, "speed", theme)
        self.traces, self.raster = Traces(theme, sensor), Raster(theme, sensor)
        self.overlays = [Overlay(theme, names_marks=row == 0) for row in range(len(self.plots))]
        for plot, image in ((self.trace_plot, self.traces), (self.raster_plot, self.raster)):
            plot.invertY(True)
            plot.addItem(image)
        for plot, overlay in zip(self.plots, self.overlays, strict=True):
            plot.addItem(overlay, ignoreBounds=True)
            plot.getAxis("bottom").setTicks([[], []])
        for row, stretch in enumerate(_ROW_STRETCH):
            layout.layout.setRowStretchFactor(row, stretch)
        self._layout, self._times = layout.layout, (0.0, 0.0, 0.0)
        self.trace_plot.getViewBox().sigResized.connect(lambda _: self._label_taxels())
        self.raster_plot.getViewBox().sigResized.connect(lambda _: self._fit_labels())
        self.show_taxels(self._taxels)

    @property
    def taxels(self) -> tuple[int, ...]:
        """The shown taxels, from 0."""
        return self._taxels

    def set_sensor_layout(self, sensor: SensorLayout) -> None:
        """Show all taxels of another sensor."""
        self._sensor = sensor
        self.traces.set_sensor_layout(sensor)
        self.show_taxels(range(sensor.n_taxels))

    def show_taxels(self, taxels: Sequence[int]) -> None:
        """Show only these taxels, from 0, in traces and raster."""
        self._taxels = tuple(taxels)
        self.traces.show_taxels(self._taxels)
        self.raster.show_rows(TrainRows(self._sensor, self._taxels))
        for plot, image in ((self.trace_plot, self.traces), (self.raster_plot, self.raster)):
            plot.setYRange(0, image.n_rows, padding=0)
        self._label_rows()
        self._label_taxels()

    def set_value_scale(self, scale: ValueScale) -> None:
        """Label the readings in counts or volts."""
        if scale != self._scale:
            self._scale = scale
            self._label_taxels()

    def set_theme(self, theme: Theme) -> None:
        """Apply a theme to all plots."""
        self._theme = theme
        views: tuple[Traces | Raster | SetPointPlot | Overlay, ...] = (
            self.traces, self.raster, self.force, self.speed, *self.overlays,
        )  # fmt: skip
        for view in views:
            view.set_theme(theme)
        for row, plot in enumerate(self.plots):
            colour_axes(plot, theme)
            least_px = _LAST_ROW_PX if row == len(self.plots) - 1 else _ROW_PX
            self._layout.setRowMinimumHeight(row, scaled_px(least_px))
        self._layout.setColumnMinimumWidth(0, _LEAST_WIDTH_PX + scaled_px(LEFT_PX))
        self._times = (0.0, 0.0, 0.0)
        self._label_rows()
        self._label_taxels()

    def refresh(
        self, timeline: Timeline, drum: DrumCourse, window: TimeWindow, ratio: float
    ) -> None:
        """Draw what the window shows; ``ratio``: pixels of the screen in one of Qt's."""
        self._set_times(window.left_s, window.right_s)
        for plot, image in ((self.trace_plot, self.traces), (self.raster_plot, self.raster)):
            _refresh_image(plot, image, timeline, window, ratio)
        time_s, columns = drum.within(window)
        self.force.refresh(time_s, columns["force_g"], columns["force_set_g"])
        self.speed.refresh(time_s, columns["speed_mm_s"], columns["speed_set_mm_s"])

    def show_lines(
        self, marks: list[MarkLine], cursor_s: float | None, reference_s: float | None
    ) -> None:
        """Show events and cursors."""
        for plot, overlay in zip(self.plots, self.overlays, strict=True):
            overlay.set_rect(QRectF(plot.getViewBox().viewRect()))
            overlay.show_lines(marks, cursor_s, reference_s)

    def set_caption(self, caption: str) -> None:
        """Say below the time axis what its zero is."""
        if caption != self._caption:
            self._caption = caption
            self._show_caption()

    def _label_rows(self) -> None:
        """Label single raster rows if there is space, else their groups."""
        row_px = self.raster_plot.getViewBox().height() / self.raster.n_rows
        rows = self.raster.rows
        ticks = rows.row_ticks() if row_px >= scaled_px(_ROW_LABEL_PX) else rows.group_ticks()
        self.raster_plot.getAxis("left").setTicks([ticks, []])

    def _fit_labels(self) -> None:
        self._show_caption()
        self._label_rows()
        left_s, right_s, _ = self._times
        if left_s < right_s:  # nothing else draws a page that does not play
            self._set_times(left_s, right_s)

    def _show_caption(self) -> None:
        room_px = self.raster_plot.getViewBox().width()
        is_long = text_width_px(self._caption) > room_px
        caption = _SHORT_CAPTIONS[self._caption] if is_long else self._caption
        label_axis(self.raster_plot, "bottom", caption, self._theme)

    def _label_taxels(self) -> None:
        axis, n = self.trace_plot.getAxis("left"), len(self._taxels)
        if n == 1:
            low, high = self.traces.range_of(self._taxels[0])
            axis.setTicks([self._scale.ticks(low, high), []])
            label = f"T{self._taxels[0] + 1}<br>({self._scale.unit})"
        else:
            band_px = self.trace_plot.getViewBox().height() / n
            step = max(1, -(-n // MAX_TICKS), ceil(scaled_px(_TAXEL_LABEL_PX) / max(band_px, 1.0)))
            names = [(i + 0.5, f"T{self._taxels[i] + 1}") for i in range(0, n, step)]
            axis.setTicks([names, []])
            label = OWN_RANGE if band_px * n >= scaled_px(_LONG_LABEL_PX) else "Taxels"
        label_axis(self.trace_plot, "left", label, self._theme)

    def set_range(self, low: NDArray[np.float64], high: NDArray[np.float64]) -> None:
        """Scale the bands to ``low … high`` counts, (n_taxels,) each."""
        if self.traces.set_range(low, high) and len(self._taxels) == 1:
            self._label_taxels()

    def _set_times(self, left_s: float, right_s: float) -> None:
        width_px = self.raster_plot.getViewBox().width()
        if (left_s, right_s, width_px) == self._times:
            return
        self._times = (left_s, right_s, width_px)
        ticks = time_ticks(left_s, right_s, most_ticks(width_px))
        self.raster_plot.getAxis("bottom").setTicks([ticks, []])
        self.plots[0].setXRange(left_s, right_s, padding=0)
        for course in (self.force, self.speed):
            course.set_times(left_s, right_s)


def _refresh_image(
    plot: pg.PlotItem, image: ScrollingImage, timeline: Timeline, window: TimeWindow, ratio: float
) -> None:
    area = plot.getViewBox().sceneBoundingRect()
    width = round(area.right()) - round(area.left())
    height = round(area.bottom()) - round(area.top())
    image.refresh(timeline, window, width, height, ratio)
