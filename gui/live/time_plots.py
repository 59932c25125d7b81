"""Force, speed, traces and raster over one time axis, each plot with its marks."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil, floor

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray
from PySide6.QtCore import QRectF
from PySide6.QtGui import QPainter, QPen, QPolygonF
from PySide6.QtWidgets import QGraphicsItem

from gui.live.drum_course import DrumCourse, thin_out
from gui.live.eye_filter import EyeFilter
from gui.live.live_data import ValueScale
from gui.live.navigation import MarkLine, Overlay
from gui.live.raster import Raster, ScrollingImage, TrainRows
from gui.live.sample_history import SPAN_S, PixelColumns, SampleHistory, TimeWindow
from gui.widgets.plot_axes import (
    LEFT_PX,
    MAX_TICKS,
    Plot,
    colour_axes,
    label_axis,
    most_ticks,
    text_width_px,
    time_plot,
    time_ticks,
)
from gui.widgets.theme import Theme, blend, rgb, scaled_px, text_scale
from rigctl.session.sensor_layout import SensorLayout

_HEADROOM = 1.1
_DASHES = (5, 4)
_MARGIN = 0.04
LEAST_HEIGHT = 2.0
"""In g or mm/s, of a part of an axis: three whole numbers stand beside it."""
WORDS_PT = 7.5
ENLARGED = "enlarged"
_ROUND_TOPS = (50, 100, 150, 200, 300, 400, 600, 800, 1200, 1600, 2000, 3000)


class PlotLine(QGraphicsItem):
    """A polyline with a fixed bounding rectangle, so that new points cost only their drawing."""

    def __init__(self) -> None:
        super().__init__()
        self._points = QPolygonF()
        self.pen = QPen()
        self._bottom, self._top = 0.0, 1.0
        self._left_s, self._right_s = -float(SPAN_S), 0.0

    def set_pen(self, colour: str, *, is_dashed: bool = False) -> None:
        """Set the colour of the line."""
        self.pen = pg.mkPen(colour, width=1, dash=_DASHES if is_dashed else None)
        self.update()

    def set_values(self, bottom: float, top: float) -> None:
        """Set the lower and upper ends of the bounding rectangle, which has a small margin."""
        self.prepareGeometryChange()
        self._bottom, self._top = bottom, top

    def set_times(self, left_s: float, right_s: float) -> None:
        """Set the left and right ends of the bounding rectangle."""
        if (left_s, right_s) != (self._left_s, self._right_s):
            self.prepareGeometryChange()
            self._left_s, self._right_s = left_s, right_s

    def set_points(self, x: NDArray[np.float64], y: NDArray[np.float64]) -> None:
        """Set the points, (n,) each."""
        self._points = pg.functions.arrayToQPolygonF(x, y) if len(x) else QPolygonF()
        self.update()

    def boundingRect(self) -> QRectF:
        """Return the rectangle of the whole plot."""
        width, height = self._right_s - self._left_s, self._top - self._bottom
        return QRectF(self._left_s, self._bottom - 0.1 * height, width, 1.2 * height)

    def paint(self, painter: QPainter, *_: object) -> None:
        """Draw the line; a polyline with a thin pen costs a fifth of a path."""
        painter.setPen(self.pen)
        painter.drawPolyline(self._points)


class SetPointPlot:
    """A measured quantity over its set-point; the scale changes in round steps only.

    ``values``: lowest and highest value of the whole axis. ``part``: those of a part of it that is
    shown in its place, which then says so; it stays until all is shown again.
    """

    def __init__(self, plot: Plot, colour: str, theme: Theme) -> None:
        self._plot = plot
        self._colour = colour
        self._set_point, self._measured = PlotLine(), PlotLine()
        for line in (self._set_point, self._measured):
            plot.addItem(line)
        self.values = (0.0, 0.0)
        self.part: tuple[float, float] | None = None
        self._newest = 0.0
        self._words = pg.LabelItem("")
        self._words.setParentItem(plot.getViewBox())
        self._words.anchor(itemPos=(1, 1), parentPos=(1, 1))
        self._theme = theme
        self._set_scale(0.0, 0.0)
        self.set_theme(theme)

    def set_theme(self, theme: Theme) -> None:
        """Apply a theme."""
        self._theme = theme
        self._set_point.set_pen(theme.set_point, is_dashed=True)
        self._measured.set_pen(getattr(theme, self._colour))
        self._show_axis()

    def set_times(self, left_s: float, right_s: float) -> None:
        """Set the ends of the time axis."""
        for line in (self._set_point, self._measured):
            line.set_times(left_s, right_s)

    def refresh(
        self,
        time_s: NDArray[np.float64],
        measured: NDArray[np.float64],
        set_point: NDArray[np.float64],
    ) -> None:
        """Show (n,) values at times of the axis, ``time_s`` (ascending)."""
        self._measured.set_points(*thin_out(time_s, measured))
        self._set_point.set_points(*corners(time_s, set_point))
        if len(time_s):
            self._newest = float(measured[-1])
            lowest, highest = float(measured.min()), float(max(measured.max(), set_point.max()))
            self._set_scale(lowest, highest)

    @property
    def height_px(self) -> float:
        """Height of the axis."""
        return float(self._plot.getViewBox().height())

    def zoom(self, factor: float, share: float | None = None) -> None:
        """Show ``factor`` times as much, in whole numbers, up to the whole axis.

        The value at a share of the height, 0 at the bottom, stays; without one, the newest.
        """
        low, high = self.part or self.values
        height = (high - low) * factor
        height = max(2 * floor(height / 2), LEAST_HEIGHT) if factor < 1 else 2 * ceil(height / 2)
        if share is None:
            inside = min(max((self._newest - low) / (high - low), 0.0), 1.0)
        else:
            inside = (1 + 2 * _MARGIN) * share - _MARGIN
        bottom = float(round(low + inside * (high - low - height)))
        is_part = height < self.values[1] - self.values[0]
        self.show_part((bottom, bottom + height) if is_part else None)

    def show_part(self, part: tuple[float, float] | None, share: float = 0.0) -> None:
        """Show a part of the axis, higher by a share of its height, or with None all of it."""
        if part is not None:
            by = round(share * (part[1] - part[0]))
            part = part[0] + by, part[1] + by
        self.part = part
        self._show_axis()

    def _set_scale(self, lowest: float, highest: float) -> None:
        top = _round_end(highest)
        bottom = 0.0 if lowest >= -_MARGIN * top else -_round_end(-lowest)
        if (bottom, top) == self.values:
            return
        self.values = (bottom, top)
        for line in (self._set_point, self._measured):
            line.set_values(bottom, top)
        self._show_axis()

    def _show_axis(self) -> None:
        bottom, top = self.part or self.values
        margin = _MARGIN * (top - bottom)
        self._plot.setYRange(bottom - margin, top + margin, padding=0)
        values = _ticks(bottom, top) if self.part is None else (bottom, (bottom + top) / 2, top)
        ticks = [(value, f"{value:.0f}".replace("-", "−")) for value in values]
        self._plot.getAxis("left").setTicks([ticks, []])
        words = ENLARGED if self.part is not None else ""
        size = f"{WORDS_PT * text_scale():g}pt"
        self._words.setText(words, color=self._theme.text, size=size)


def corners(
    x: NDArray[np.float64], y: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the ends of each stretch of equal values: dashes of many short lines cost more."""
    if not len(y):
        return x, y
    is_end = np.ones((2, len(y)), bool)  # of a stretch's first and last value
    is_end[0, 1:] = is_end[1, :-1] = y[1:] != y[:-1]
    kept = np.flatnonzero(is_end[0] | is_end[1])
    return thin_out(x[kept], y[kept])


def _round_end(value: float) -> float:
    """Return a round end of an axis that leaves headroom above ``value``."""
    least = value * _HEADROOM
    return float(next((top for top in _ROUND_TOPS if top >= least), least))


def _ticks(bottom: float, top: float) -> tuple[float, ...]:
    """Return 0, the ends and, where nothing is negative, the middle."""
    return (bottom, 0.0, top) if bottom else (0.0, top / 2, top)


FULL_SCALE = 1023


class Traces(ScrollingImage):
    """One band per taxel, scaled to its range; the layers differ in colour."""

    def __init__(self, theme: Theme, layout: SensorLayout) -> None:
        super().__init__(layout.n_taxels, theme)
        self.sensor_layout = layout
        self.taxels = np.arange(layout.n_taxels)
        self._low = np.zeros(layout.n_taxels)
        self._high = np.full(layout.n_taxels, float(FULL_SCALE))
        self.gain = 1.0
        self.eye: EyeFilter | None = None

    def set_view(self, gain: float, eye: EyeFilter | None) -> None:
        """Draw readings ``gain`` times as high about the middle of their bands, or filtered."""
        self.gain, self.eye = gain, eye
        self._is_stale = True

    def set_sensor_layout(self, layout: SensorLayout) -> None:
        """Show all taxels of another sensor, coloured by its layers."""
        if layout.n_taxels != len(self._low):
            self._low = np.zeros(layout.n_taxels)
            self._high = np.full(layout.n_taxels, float(FULL_SCALE))
        self.sensor_layout = layout
        self.show_taxels(range(layout.n_taxels))

    def set_range(self, low: NDArray[np.float64], high: NDArray[np.float64]) -> bool:
        """Scale the bands to ``low … high`` counts, (n_taxels,); redraw where the change shows.

        Return whether they changed.
        """
        is_empty = high - low < 1
        low, high = np.where(is_empty, 0.0, low), np.where(is_empty, FULL_SCALE, high)
        change = np.maximum(np.abs(low - self._low), np.abs(high - self._high))
        if change.max() == 0:
            return False
        span = np.maximum(self._high - self._low, 1.0)
        self._low, self._high = low, high
        self._is_stale = self._is_stale or bool((change / span).max() > 0.02)
        return True

    def range_of(self, taxel: int) -> tuple[float, float]:
        """Return the lowest and highest counts in the band of a taxel."""
        low, high = self._ends(np.array([taxel]))
        return float(low[0]), float(high[0])

    def _ends(self, taxels: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the lower and upper ends of the bands of taxels."""
        low, high = self._low[taxels], self._high[taxels]
        middle = (low + high) / 2 * (self.eye is None or not self.eye.high_hz)
        half = (high - low) / 2 / self.gain
        return middle - half, middle + half

    def show_taxels(self, taxels: Sequence[int]) -> None:
        """Show a band for each of these taxels, from 0, in this order."""
        self.prepareGeometryChange()
        self.taxels, self.n_rows = np.array(taxels, np.int64), len(taxels)
        self._is_stale = True

    def prepare(self, height: int) -> None:
        """Assign every pixel row its band and colours."""
        layout, n = self.sensor_layout, self.n_rows
        edges = np.arange(n + 1) * height // n
        self._top = edges[:-1] + 1
        self._band_height = np.maximum(np.diff(edges) - 3, 1)
        at = np.searchsorted(edges, np.arange(height), "right") - 1
        self._band = np.minimum(at, n - 1)
        inks = [rgb(colour) for colour in TrainRows(layout).layer_colours(self.theme)]
        layers = self.taxels // layout.per_layer
        self._ink = np.array(inks, np.uint32)[layers[self._band]][:, None]
        background = np.full(height, rgb(self.theme.plot), np.uint32)
        between = edges[1:-1][np.diff(layers) != 0]
        background[between] = rgb(blend(self.theme.muted, self.theme.plot, 0.5))
        self._background = background[:, None]
        self._row = np.arange(height, dtype=np.int32)[:, None]

    def render_columns(self, history: SampleHistory, columns: PixelColumns) -> NDArray[np.uint32]:
        """Return a vertical line in each band from the column's lowest to its highest reading."""
        low, high = history.extremes(columns)
        top = self._pixel_row(high).T[self._band]
        bottom = self._pixel_row(low).T[self._band]
        is_ink = (self._row >= top) & (self._row <= bottom)
        return np.where(is_ink, self._ink, self._background)

    def _pixel_row(self, counts: NDArray[np.uint16]) -> NDArray[np.int32]:
        low, high = self._ends(self.taxels)
        shown = counts[:, self.taxels]
        share = ((shown if self.eye is None else self.eye.decode(shown)) - low) / (high - low)
        down = (1.0 - np.clip(share, 0.0, 1.0)) * self._band_height
        return np.asarray(self._top + down, np.int32)


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
        self.courses = (self.force, self.speed)
        self.traces, self.raster = Traces(theme, sensor), Raster(theme, sensor)
        self.overlays = [Overlay(theme, names_marks=row == 0) for row in range(len(self.plots))]
        for plot, image in ((self.trace_plot, self.traces), (self.raster_plot, self.raster)):
            plot.invertY(True)
            plot.addItem(image)
        for plot, overlay in zip(self.plots, self.overlays, strict=True):
            plot.addItem(overlay)
            plot.getAxis("bottom").setTicks([[], []])
        for row, stretch in enumerate(_ROW_STRETCH):
            layout.layout.setRowStretchFactor(row, stretch)
        self._eye_words = pg.TextItem("")
        self._eye_words.setParentItem(self.trace_plot.getViewBox())
        self._eye_words.setVisible(False)
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

    def set_view(self, gain: float, eye: EyeFilter | None) -> None:
        """Show the traces higher, or filtered, which their plot then says."""
        self.traces.set_view(gain, eye)
        self._eye_words.setText(eye.words if eye is not None else "")
        self._eye_words.setVisible(eye is not None)
        self._label_taxels()

    def set_theme(self, theme: Theme) -> None:
        """Apply a theme to all plots."""
        self._theme = theme
        self._eye_words.setColor(theme.text)
        self._eye_words.fill = pg.mkBrush(theme.plot)
        views: tuple[Traces | Raster | SetPointPlot | Overlay, ...] = (
            self.traces, self.raster, *self.courses, *self.overlays,
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
        self, history: SampleHistory, drum: DrumCourse, window: TimeWindow, ratio: float
    ) -> None:
        """Draw what the window shows; ``ratio``: pixels of the screen in one of Qt's."""
        self._set_times(window.left_s, window.right_s)
        eye = self.traces.eye
        seen = history if eye is None else eye.history
        _refresh_image(self.trace_plot, self.traces, seen, window, ratio)
        _refresh_image(self.raster_plot, self.raster, history, window, ratio)
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
        self._eye_words.setTextWidth(max(1.0, self.trace_plot.getViewBox().width()))
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
        for course in self.courses:
            course.set_times(left_s, right_s)


def _refresh_image(
    plot: Plot,
    image: ScrollingImage,
    history: SampleHistory,
    window: TimeWindow,
    ratio: float,
) -> None:
    area = plot.getViewBox().sceneBoundingRect()
    width = round(area.right()) - round(area.left())
    height = round(area.bottom()) - round(area.top())
    image.refresh(history, window, width, height, ratio)
