"""The spike raster, the rates of the last second beside it, and the map of the readings."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray
from PySide6.QtCore import QPointF, QRectF, Qt
from PySide6.QtGui import QColor, QFont, QImage, QPainter, QPolygonF, QTransform
from PySide6.QtWidgets import QGraphicsItem, QGraphicsWidget

from gui.live.live_data import LiveData, ValueScale
from gui.live.sample_history import SPAN_S, PixelColumns, SampleHistory, TimeWindow
from gui.widgets.plot_axes import Plot, label_axis
from gui.widgets.theme import Theme, blend, rgb, scaled_px, text_scale
from rigctl.config.rig_config import LAYER_NAMES
from rigctl.session.sensor_layout import SensorLayout
from rigctl.values import SAMPLE_RATE_HZ

_STRIPE_AT, _STRIPE_STEP = 3, 6
"""Rows of the stripes by which lost samples are told without colours."""
_START = TimeWindow(0, SPAN_S * SAMPLE_RATE_HZ, 0)


class ScrollingImage(QGraphicsItem):
    """Rows over time; subclasses render the columns.

    Its rectangle in plot units is that of the time window in seconds by ``0 … n_rows``, row 0 at
    the top (its view has an inverted y axis).
    """

    def __init__(self, n_rows: int, theme: Theme) -> None:
        super().__init__()
        self.n_rows = n_rows
        self.theme = theme
        self.shown = _START
        self._pixels = np.zeros((1, 1), np.uint32)
        self._head = 0
        self._drawn = (0, -1)
        self._last = -1
        self._ratio = 1.0
        self._source: tuple[SampleHistory | None, int] = (None, -1)
        self._is_stale = True

    def set_theme(self, theme: Theme) -> None:
        """Apply a theme; the next refresh redraws everything."""
        self.theme = theme
        self._is_stale = True

    def refresh(
        self, history: SampleHistory, window: TimeWindow, width: int, height: int, ratio: float
    ) -> None:
        """Draw the columns that are new in a view of ``width`` × ``height`` logical pixels."""
        shape = (max(1, round(height * ratio)), max(1, round(width * ratio)))
        source = (history, history.generation)
        if shape != self._pixels.shape or source != self._source:
            self._is_stale = True
        if self._is_stale or window.span != self.shown.span:
            self._reset(shape, ratio, source)
        if (window.left_s, window.span) != (self.shown.left_s, self.shown.span):
            self.prepareGeometryChange()
        self.shown = window
        self._head = window.right * shape[1] // window.span
        if len(history):
            self._draw_new(history)
        self.update()

    def boundingRect(self) -> QRectF:
        """Return the image's rectangle in plot units."""
        window = self.shown
        return QRectF(window.left_s, 0.0, window.span / SAMPLE_RATE_HZ, float(self.n_rows))

    def paint(self, painter: QPainter, *_: object) -> None:
        """Paint the ring of columns, first the older ones behind the head."""
        area = painter.worldTransform().mapRect(self.boundingRect())
        left, top = round(area.left()), round(area.top())
        height, width = self._pixels.shape
        image = QImage(self._pixels.data, width, height, 4 * width, QImage.Format.Format_RGB32)
        image.setDevicePixelRatio(self._ratio)
        split = (self._head + 1) % width
        painter.save()
        painter.setWorldTransform(QTransform())
        painter.drawImage(left, top, image, split, 0, width - split, height)
        painter.drawImage(
            round(left + (width - split) / self._ratio), top, image, 0, 0, split, height
        )
        painter.restore()

    def render_columns(self, history: SampleHistory, columns: PixelColumns) -> NDArray[np.uint32]:
        """Return the pixels of some columns, uint32 (height, k); subclasses implement it."""
        # Qt's metaclass and ABCMeta do not combine, so the method cannot be declared abstract.
        raise NotImplementedError

    def prepare(self, height: int) -> None:
        """Compute tables for another height or theme; subclasses that need them implement it."""

    def _reset(
        self, shape: tuple[int, int], ratio: float, source: tuple[SampleHistory, int]
    ) -> None:
        is_prepared = not self._is_stale
        self._pixels = np.full(shape, rgb(self.theme.plot), np.uint32)
        self._drawn = (0, -1)
        self._ratio = ratio
        self._source = source
        self._is_stale = False
        if not is_prepared:
            self.prepare(shape[0])

    def _draw_new(self, history: SampleHistory) -> None:
        """Draw the columns in view that are not drawn, or were drawn before all samples came."""
        width = self._pixels.shape[1]
        first, last = self._head - width + 1, self._head
        drawn_first, drawn_last = self._drawn
        newest = history.newest * width // self.shown.span
        if drawn_first > last or drawn_last < first or drawn_first > drawn_last:
            self._draw(history, first, last)
        else:
            if first < drawn_first:
                self._draw(history, first, drawn_first - 1)
            # Where the right edge stands still, columns behind the newest are blank already.
            end = min(last, newest) if last == self._last else last
            if end > drawn_last:
                self._draw(history, drawn_last + 1, end)
        self._last = last
        self._drawn = (first, min(last, newest - 1))

    def _draw(self, history: SampleHistory, first: int, last: int) -> None:
        width = self._pixels.shape[1]
        columns = history.columns(first, last, width, self.shown.span)
        pixels = self.render_columns(history, columns)
        pixels[:, columns.missing] = rgb(self.theme.gap)
        pixels[_STRIPE_AT::_STRIPE_STEP, columns.missing] = rgb(self.theme.bad)
        pixels[:, columns.blank] = rgb(self.theme.plot)
        at, n = first % width, last - first + 1
        n_before_seam = min(n, width - at)
        self._pixels[:, at : at + n_before_seam] = pixels[:, :n_before_seam]
        self._pixels[:, : n - n_before_seam] = pixels[:, n_before_seam:]


class TrainRows:
    """Rows of a raster from the top: SA and RA of the top layer, then of those below.

    ``order``: the encoder's row in each raster row, int64 (n_rows,); the encoder has SA 1 … n,
    then RA 1 … n. ``group_of``: the group of each raster row, int64 (n_rows,).
    ``taxels``: those whose trains have a row, from 0; None for all.
    """

    def __init__(self, layout: SensorLayout, taxels: Collection[int] | None = None) -> None:
        self.sensor_layout = layout
        groups = layout.train_groups()
        self.group_names = tuple(name for name, _ in groups)
        order = np.concatenate([np.array(rows, np.int64) for _, rows in groups])
        group_of = np.repeat(np.arange(len(groups)), layout.per_layer)
        shown = [*range(layout.n_taxels)] if taxels is None else [*taxels]
        kept = np.isin(order % layout.n_taxels, shown)
        self.order, self.group_of = order[kept], group_of[kept]

    def __len__(self) -> int:
        return len(self.order)

    def label(self, row: int) -> str:
        """Return the name of a raster row, as in the paper: T_SA-1 … T_RA-18."""
        channel, taxel = divmod(int(self.order[row]), self.sensor_layout.n_taxels)
        return f"T_{('SA', 'RA')[channel]}-{taxel + 1}"

    def group_ticks(self) -> list[tuple[float, str]]:
        """Return an axis tick for each group: its middle from the top in rows, and its name."""
        ticks = []
        for group, name in enumerate(self.group_names):
            if len(rows := np.flatnonzero(self.group_of == group)):
                ticks.append((float(rows.mean()) + 0.5, name))
        return ticks

    def row_ticks(self) -> list[tuple[float, str]]:
        """Return an axis tick for each row: its middle from the top, and its name."""
        return [(row + 0.5, self.label(row)) for row in range(len(self))]

    def group_colours(self, theme: Theme) -> list[str]:
        """Return the colour of each group."""
        top, bottom = theme.groups[:2], theme.groups[2:]
        return [
            self._shade(top[group % 2], bottom[group % 2], group // 2)
            for group in range(len(self.group_names))
        ]

    def layer_colours(self, theme: Theme) -> list[str]:
        """Return the colour of each layer."""
        layers = range(len(self.sensor_layout.layers))
        return [self._shade(*theme.layers, layer) for layer in layers]

    def _shade(self, top: str, bottom: str, layer: int) -> str:
        """Return the colour of a layer, evenly between those of the top and of the bottom one."""
        return blend(bottom, top, layer / max(len(self.sensor_layout.layers) - 1, 1))


def layer_titles(layout: SensorLayout, unit: str = "counts") -> tuple[str, ...]:
    """Return a title for the map of each layer."""
    if len(layout.layers) == 1:
        return (f"Readings now, {unit}",)
    if len(layout.layers) == 2:
        places = ("Top layer", "Bottom layer")
        return tuple(
            f"{place} ({f'type {name}' if name in LAYER_NAMES else name}), {unit}"
            for place, name in zip(places, layout.layers, strict=True)
        )
    return tuple(f"Layer {name}, {unit}" for name in layout.layers)


class Raster(ScrollingImage):
    """One tick per pixel column with at least one spike."""

    def __init__(self, theme: Theme, layout: SensorLayout) -> None:
        super().__init__(2 * layout.n_taxels, theme)
        self.rows = TrainRows(layout)

    def set_sensor_layout(self, layout: SensorLayout) -> None:
        """Group the rows by the layers of another sensor with as many taxels."""
        self.show_rows(TrainRows(layout))

    def show_rows(self, rows: TrainRows) -> None:
        """Show other rows of the trains."""
        self.prepareGeometryChange()
        self.rows, self.n_rows = rows, len(rows)
        self._is_stale = True

    def prepare(self, height: int) -> None:
        """Assign every pixel row its raster row, ink and background."""
        n_rows, group_of = len(self.rows), self.rows.group_of
        edges = np.arange(n_rows + 1) * height // n_rows
        at = np.searchsorted(edges, np.arange(height), "right") - 1
        self._row = np.clip(at, 0, n_rows - 1)
        inks = np.array([rgb(colour) for colour in self.rows.group_colours(self.theme)], np.uint32)
        self._ink = inks[group_of][self._row][:, None]
        shades = [self.theme.plot, blend(self.theme.muted, self.theme.plot, 0.07)]
        backgrounds = np.array([rgb(shade) for shade in shades], np.uint32)
        self._background = backgrounds[group_of % 2][self._row][:, None]
        self._is_tick = np.ones((height, 1), bool)
        if height >= 4 * n_rows:
            self._is_tick[edges[:-1]] = False

    def render_columns(self, history: SampleHistory, columns: PixelColumns) -> NDArray[np.uint32]:
        """Return ink where the column has a spike."""
        spikes = history.spike_columns(columns)
        is_ink = spikes[:, self.rows.order].T[self._row] & self._is_tick
        return np.where(is_ink, self._ink, self._background)


FULL_SCALE_HZ = 300.0
RATE_TICKS_HZ = (0, 100, 200)
FULL_SCALE_A_MM = 6.0
RATE_TICKS_A_MM = (0, 2, 4)
LEAST_TRAVEL_MM = 1.0
"""With less in the window, spikes per mm would be a division by nearly nothing: no bars."""
WINDOW_S = 1.0


class RateBars(QGraphicsItem):
    """Horizontal bars from 0 to the rate, in the raster's row order.

    ``rates_hz``: spikes a second, (n_rows,). ``rates_a_mm``: spikes a mm of texture where these
    are shown, else None. ``is_per_mm``: whether they are to be shown.
    """

    def __init__(self, theme: Theme, layout: SensorLayout) -> None:
        super().__init__()
        self.theme = theme
        self.rows = TrainRows(layout)
        self.rates_hz = np.zeros(len(self.rows))
        self.rates_a_mm: NDArray[np.float64] | None = None
        self.is_per_mm = False

    def set_sensor_layout(self, layout: SensorLayout) -> None:
        """Order the bars by the layers of another sensor with as many taxels."""
        self.show_rows(TrainRows(layout))

    def show_rows(self, rows: TrainRows) -> None:
        """Show other rows of the trains."""
        self.prepareGeometryChange()
        self.rows = rows
        self.rates_hz, self.rates_a_mm = np.zeros(len(rows)), None

    def set_theme(self, theme: Theme) -> None:
        """Apply a theme."""
        self.theme = theme
        self.update()

    def refresh_at(self, data: LiveData, position: int) -> None:
        """Show the rates of the second up to a position."""
        n = round(WINDOW_S * SAMPLE_RATE_HZ)
        travelled_mm = data.drum.travelled_mm(position, n) if self.is_per_mm else None
        self.refresh(data.spikes_before(position, n), travelled_mm)

    def refresh(self, spikes: NDArray[np.uint8], travelled_mm: float | None = None) -> None:
        """Show the rates of the newest second of spikes, uint8 (n, n_rows), encoder's order.

        ``travelled_mm``: show spikes per mm of this texture instead of per second.
        """
        newest = spikes[-round(WINDOW_S * SAMPLE_RATE_HZ) :]
        seconds = max(len(newest), 1) / SAMPLE_RATE_HZ
        counts = newest.sum(axis=0, dtype=np.int64)[self.rows.order]
        self.rates_hz, self.rates_a_mm = counts / seconds, None
        if travelled_mm is not None:
            has_moved = travelled_mm >= LEAST_TRAVEL_MM
            self.rates_a_mm = counts / travelled_mm if has_moved else np.zeros(len(counts))
        self.update()

    def boundingRect(self) -> QRectF:
        """Return the rectangle of all rows up to the full scale."""
        return QRectF(0.0, 0.0, FULL_SCALE_HZ, float(len(self.rows)))

    def paint(self, painter: QPainter, *_: object) -> None:
        """Draw one rectangle per row."""
        colours = [QColor(colour) for colour in self.rows.group_colours(self.theme)]
        shown = self.rates_hz
        if self.rates_a_mm is not None:
            shown = self.rates_a_mm * (FULL_SCALE_HZ / FULL_SCALE_A_MM)
        for row, rate in enumerate(np.minimum(shown, FULL_SCALE_HZ)):
            colour = colours[self.rows.group_of[row]]
            painter.fillRect(QRectF(0.0, row + 0.12, float(rate), 0.76), colour)


A_SECOND = "Rate in the last second (Hz)"
A_MM = "Rate in the last second (1/mm)"


def label_rates(plot: Plot, theme: Theme, is_per_mm: bool) -> None:
    """Write the numbers and the unit of the rates below a plot whose width is the full scale."""
    ticks = [(float(hz), f"{hz}") for hz in RATE_TICKS_HZ]
    if is_per_mm:
        ticks = [(n * FULL_SCALE_HZ / FULL_SCALE_A_MM, f"{n}") for n in RATE_TICKS_A_MM]
    plot.getAxis("bottom").setTicks([ticks, []])
    label_axis(plot, "bottom", A_MM if is_per_mm else A_SECOND, theme)


_TITLE_PX, _LAYER_PX = 18, 78
MEAN_SAMPLES = 32


DARK_INK_SHARE = 0.44
"""Place in the range from which black is read better than white."""
_MARK_PX = 6.0


class HeatMap(QGraphicsWidget):
    """Each cell shows a taxel's reading in counts, and by colour its place in the taxel's range.

    A triangle in the cell's corner points up for a reading above the range, down for one below.
    ``beyond``: 1 above, −1 below, 0 inside, (taxels,).
    """

    def __init__(self, theme: Theme, layout: SensorLayout) -> None:
        super().__init__()
        self.theme = theme
        self.value_scale = ValueScale()
        self.set_sensor_layout(layout)
        table = pg.colormap.get("viridis").getLookupTable(nPts=256)
        self._colours = [QColor(*map(int, entry)) for entry in table]

    def set_sensor_layout(self, layout: SensorLayout) -> None:
        """Draw the layers of another sensor."""
        self.sensor_layout = layout
        self._titles = layer_titles(layout, self.value_scale.unit)
        self._counts = np.zeros(layout.n_taxels)
        self._share, self.beyond = np.zeros(layout.n_taxels), np.zeros(layout.n_taxels, np.int64)
        self._has_samples = False
        self._fit_texts()

    def set_value_scale(self, scale: ValueScale) -> None:
        """Show the readings in counts or volts."""
        self.value_scale, self._titles = scale, layer_titles(self.sensor_layout, scale.unit)
        self.update()

    def set_theme(self, theme: Theme) -> None:
        """Apply a theme and the size of the texts to titles and frames."""
        self.theme = theme
        self._fit_texts()

    def _fit_texts(self) -> None:
        self._title_px = scaled_px(_TITLE_PX)
        self.setMinimumSize(120, scaled_px(_LAYER_PX) * len(self.sensor_layout.layers))
        self.update()

    def refresh_at(self, data: LiveData, position: int) -> None:
        """Show the mean of the samples up to a position."""
        self.refresh(data.samples_before(position, MEAN_SAMPLES), data.low, data.high)

    def refresh(
        self, samples: NDArray[np.uint16], low: NDArray[np.float64], high: NDArray[np.float64]
    ) -> None:
        """Show the mean of the newest of (n, taxels) samples in each taxel's range, (taxels,)."""
        self._has_samples = len(samples) > 0
        if self._has_samples:
            self._counts = samples[-MEAN_SAMPLES:].mean(axis=0)
            share = (self._counts - low) / np.maximum(high - low, 1.0)
            self._share = np.clip(share, 0.0, 1.0)
            self.beyond = np.sign(share - self._share).astype(np.int64)
        self.update()

    def paint(self, painter: QPainter, *_: object) -> None:
        """Draw the layers below each other, the top layer first, as large as possible."""
        area, n_layers = self.rect(), len(self._titles)
        rows, columns = self.sensor_layout.rows, self.sensor_layout.columns
        cell = min(area.width() / columns, (area.height() / n_layers - self._title_px - 4) / rows)
        left = area.left() + (area.width() - columns * cell) / 2
        for layer, title in enumerate(self._titles):
            top = area.top() + layer * area.height() / n_layers
            painter.setFont(self._font(8.5 * text_scale(), QFont.Weight.Normal))
            painter.setPen(QColor(self.theme.muted))
            place = QRectF(area.left(), top, area.width(), self._title_px)
            painter.drawText(place, Qt.AlignmentFlag.AlignCenter, title)
            self._paint_layer(painter, layer, QRectF(left, top + self._title_px, cell, cell))

    def _paint_layer(self, painter: QPainter, layer: int, first: QRectF) -> None:
        painter.setFont(
            self._font(min(9.5 * text_scale(), first.width() / 4.2), QFont.Weight.DemiBold)
        )
        for place, taxel in enumerate(self.sensor_layout.taxels_of(layer)):
            row, column = divmod(place, self.sensor_layout.columns)
            cell = first.translated(column * first.width(), row * first.height())
            self._paint_cell(painter, taxel, cell.adjusted(1, 1, -1, -1))

    def _paint_cell(self, painter: QPainter, taxel: int, cell: QRectF) -> None:
        if not self._has_samples:
            painter.setPen(QColor(self.theme.line))
            painter.drawRect(cell)
            return
        share = float(self._share[taxel])
        painter.fillRect(cell, self._colours[int(share * 255)])
        ink = QColor("#000000" if share > DARK_INK_SHARE else "#ffffff")
        painter.setPen(ink)
        if self.beyond[taxel]:
            painter.setBrush(ink)
            painter.drawPolygon(_mark(cell, int(self.beyond[taxel])))
        painter.drawText(cell, Qt.AlignmentFlag.AlignCenter, self._number(taxel))

    def _number(self, taxel: int) -> str:
        return self.value_scale.text(float(self._counts[taxel]), digits=2)

    def _font(self, points: float, weight: QFont.Weight) -> QFont:
        font = QFont(self.font())
        font.setPointSizeF(points)
        font.setWeight(weight)
        return font


def _mark(cell: QRectF, sign: int) -> QPolygonF:
    """Return a triangle at the right of a cell, above its number or below it."""
    size = min(_MARK_PX, cell.height() / 4)
    base = cell.top() + 2 + size if sign > 0 else cell.bottom() - 2 - size
    right = cell.right() - 2
    corners = ((right - 1.5 * size, base), (right, base), (right - 0.75 * size, base - sign * size))
    return QPolygonF([QPointF(x, y) for x, y in corners])
