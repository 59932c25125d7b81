"""The present readings of each sensor layer as a map of its rows and columns, in counts."""

from __future__ import annotations

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray
from PySide6.QtCore import QPointF, QRectF, Qt
from PySide6.QtGui import QColor, QFont, QPainter, QPolygonF
from PySide6.QtWidgets import QGraphicsWidget

from gui.live.live_data import ValueScale
from gui.live.raster import layer_titles
from gui.widgets.theme import Theme, scaled_px, text_scale
from rigctl.session.sensor_layout import SensorLayout

_TITLE_PX, _LAYER_PX = 18, 78
_MEAN_SAMPLES = 32


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

    def refresh(
        self, samples: NDArray[np.uint16], low: NDArray[np.float64], high: NDArray[np.float64]
    ) -> None:
        """Show the mean of the newest of (n, taxels) samples in each taxel's range, (taxels,)."""
        self._has_samples = len(samples) > 0
        if self._has_samples:
            self._counts = samples[-_MEAN_SAMPLES:].mean(axis=0)
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
            self._font(min(9.5 * text_scale(), first.width() / 3.4), QFont.Weight.DemiBold)
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
