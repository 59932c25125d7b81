"""The live plots: force, speed, traces and raster over one time axis; heat map and rates."""

from __future__ import annotations

import numpy as np
import pyqtgraph as pg
from PySide6.QtGui import QResizeEvent

from gui.live.force_speed import SetPointPlot
from gui.live.heatmap import HeatMap
from gui.live.history import N_ROWS, SPAN_S, History
from gui.live.raster import Raster
from gui.live.scrolling_image import ScrollingImage
from gui.live.spike_rates import FULL_SCALE_HZ, RATE_TICKS_HZ, RateBars
from gui.live.traces import Traces
from gui.widgets.plot_axes import colour_axes, fixed_plot, taxel_ticks, time_plot
from gui.widgets.theme import Theme
from rigctl.acquisition.live_buffer import LiveReader
from rigctl.session.format.sensor_layout import SensorLayout
from rigctl.values import N_TAXELS

DRUM_ROWS = 1200
_RIGHT_PX = 216
_ROW_LABEL_PX = 10
_SLOW_REFRESH_FRAMES = 3  # numbers that change thirty times a second are unreadable
_ROW_STRETCH = (2, 2, 5, 6)


class LivePlots(pg.GraphicsLayoutWidget):  # type: ignore[misc]  # pyqtgraph has no types
    """All live plots; :meth:`refresh` pulls the samples that they show."""

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self.history = History()
        self.sensor_layout = SensorLayout.default(N_TAXELS)
        self._span_s = float(SPAN_S)
        self._frame = -1
        self._build_time_plots(theme)
        self._build_right_column(theme)
        self.set_span(SPAN_S)
        self.set_theme(theme)

    def refresh(self, live: LiveReader) -> None:
        """Draw the new samples."""
        self.history.pull(live)
        low, high = (np.asarray(side, float) for side in live.normalisation)
        self.traces.set_range(low, high)
        self._refresh_image(self._trace_plot, self.traces)
        self._refresh_image(self._raster_plot, self.raster)
        self._refresh_drum(live)
        self._frame += 1
        if self._frame % _SLOW_REFRESH_FRAMES == 0:
            self.heat_map.refresh(self.history.samples, low, high)
            self.rate_bars.refresh(self.history.spikes)

    def clear_history(self) -> None:
        """Remove all samples, as when another rig is connected."""
        self.history.clear()
        self._frame = -1

    def set_sensor_layout(self, layout: SensorLayout) -> None:
        """Group taxels and trains by the layers of the sensor, if it has as many taxels."""
        if layout == self.sensor_layout or layout.n_taxels != N_TAXELS:
            return
        self.sensor_layout = layout
        for view in (self.traces, self.raster, self.rate_bars, self.heat_map):
            view.set_sensor_layout(layout)
        self._label_rows()

    def set_span(self, span_s: float) -> None:
        """Show the last ``span_s`` seconds, at most the length of the history."""
        self._span_s = min(float(span_s), float(SPAN_S))
        self._force_plot.setXRange(-self._span_s, 0.0, padding=0)
        self.traces.set_span(self._span_s)
        self.raster.set_span(self._span_s)

    def set_theme(self, theme: Theme) -> None:
        """Apply a theme to all plots."""
        self.setBackground(theme.panel)
        items = (self.traces, self.raster, self.rate_bars, self.heat_map, self.force, self.speed)
        for item in items:
            item.set_theme(theme)
        for plot in (*self._time_plots, self._rate_plot):
            colour_axes(plot, theme)
        self._label_rows()

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Label single raster rows if there is space, else their groups."""
        super().resizeEvent(event)
        if hasattr(self, "_rate_plot"):
            self._label_rows()

    def _build_time_plots(self, theme: Theme) -> None:
        labels = ("Force (g)", "Speed (mm/s)", "Taxels (own range)", "Spikes")
        self._time_plots = [
            time_plot(self.ci, row, label, last=row == 3) for row, label in enumerate(labels)
        ]
        self._force_plot, self._speed_plot, self._trace_plot, self._raster_plot = self._time_plots
        for plot in self._time_plots[1:]:
            plot.setXLink(self._force_plot)
        self.force = SetPointPlot(self._force_plot, "force", theme)
        self.speed = SetPointPlot(self._speed_plot, "speed", theme)
        self.traces, self.raster = (
            Traces(theme, self.sensor_layout),
            Raster(theme, self.sensor_layout),
        )
        for plot, image in ((self._trace_plot, self.traces), (self._raster_plot, self.raster)):
            plot.invertY(True)
            plot.setYRange(0, image.n_rows, padding=0)
            plot.addItem(image)
        self._trace_plot.getAxis("left").setTicks([taxel_ticks(N_TAXELS), []])
        for row, stretch in enumerate(_ROW_STRETCH):
            self.ci.layout.setRowStretchFactor(row, stretch)
            self.ci.layout.setRowMinimumHeight(row, 54)

    def _build_right_column(self, theme: Theme) -> None:
        self.heat_map, self.rate_bars = (
            HeatMap(theme, self.sensor_layout),
            RateBars(theme, self.sensor_layout),
        )
        self.ci.addItem(self.heat_map, row=0, col=1, rowspan=3)
        self._rate_plot = fixed_plot(self.ci, 3, 1)
        self._rate_plot.setLabel("bottom", "Rate in the last second (Hz)")
        self._rate_plot.getAxis("bottom").setHeight(self._raster_plot.getAxis("bottom").height())
        self._rate_plot.getAxis("bottom").setTicks([[(hz, f"{hz}") for hz in RATE_TICKS_HZ], []])
        self._rate_plot.hideAxis("left")
        self._rate_plot.setXRange(0, FULL_SCALE_HZ, padding=0)
        self._rate_plot.invertY(True)
        self._rate_plot.setYRange(0, N_ROWS, padding=0)
        self._rate_plot.addItem(self.rate_bars)
        self.ci.layout.setHorizontalSpacing(16)
        self.ci.layout.setColumnFixedWidth(1, _RIGHT_PX)

    def _refresh_image(self, plot: pg.PlotItem, image: ScrollingImage) -> None:
        area = plot.getViewBox().sceneBoundingRect()
        width = round(area.right()) - round(area.left())
        height = round(area.bottom()) - round(area.top())
        image.refresh(self.history, width, height, self.devicePixelRatioF())

    def _refresh_drum(self, live: LiveReader) -> None:
        window = live.drum(DRUM_ROWS)
        newest_s = max(self.history.newest_s, float(window.time_s[-1]) if len(window) else 0.0)
        shown = window.time_s > newest_s - self._span_s - 0.5
        time_s = window.time_s[shown] - newest_s
        self.force.refresh(time_s, window.force_g[shown], window.force_set_g[shown])
        self.speed.refresh(time_s, window.speed_mm_s[shown], window.speed_set_mm_s[shown])

    def _label_rows(self) -> None:
        row_px = self._raster_plot.getViewBox().height() / N_ROWS
        rows = self.raster.rows
        ticks = rows.row_ticks() if row_px >= _ROW_LABEL_PX else rows.group_ticks()
        self._raster_plot.getAxis("left").setTicks([ticks, []])
