"""Stacked taxel traces: minimum and maximum of every pixel column."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gui.live.history import History
from gui.live.scrolling_image import PixelColumns, ScrollingImage, blend, rgb
from gui.live.train_rows import TrainRows
from gui.widgets.theme import Theme
from rigctl.session.format.sensor_layout import SensorLayout

FULL_SCALE = 1023


class Traces(ScrollingImage):
    """One band per taxel, scaled to its range; the layers differ in colour."""

    def __init__(self, theme: Theme, layout: SensorLayout) -> None:
        super().__init__(layout.n_taxels, theme)
        self.sensor_layout = layout
        self._low = np.zeros(layout.n_taxels)
        self._high = np.full(layout.n_taxels, float(FULL_SCALE))

    def set_sensor_layout(self, layout: SensorLayout) -> None:
        """Colour the bands by the layers of another sensor with as many taxels."""
        self.sensor_layout = layout
        self._is_stale = True

    def set_range(self, low: NDArray[np.float64], high: NDArray[np.float64]) -> None:
        """Scale the bands to ``low … high`` counts, (n_taxels,); redraw where the change shows."""
        low, high = np.asarray(low, float), np.asarray(high, float)
        is_empty = high - low < 1
        low, high = np.where(is_empty, 0.0, low), np.where(is_empty, FULL_SCALE, high)
        change = np.maximum(np.abs(low - self._low), np.abs(high - self._high))
        if change.max() == 0:
            return
        span = np.maximum(self._high - self._low, 1.0)
        self._low, self._high = low, high
        self._is_stale = self._is_stale or bool((change / span).max() > 0.02)

    def prepare(self, height: int) -> None:
        """Assign every pixel row its band and colours."""
        layout = self.sensor_layout
        edges = np.arange(layout.n_taxels + 1) * height // layout.n_taxels
        self._top = edges[:-1] + 1
        self._band_height = np.maximum(np.diff(edges) - 3, 1)
        at = np.searchsorted(edges, np.arange(height), "right") - 1
        self._band = np.minimum(at, layout.n_taxels - 1)
        inks = [rgb(colour) for colour in TrainRows(layout).layer_colours(self.theme)]
        layer = self._band // layout.per_layer
        self._ink = np.array(inks, np.uint32)[layer][:, None]
        background = np.full(height, rgb(self.theme.plot), np.uint32)
        between = edges[layout.per_layer : -1 : layout.per_layer]
        background[between] = rgb(blend(self.theme.muted, self.theme.plot, 0.5))
        self._background = background[:, None]
        self._row = np.arange(height, dtype=np.int32)[:, None]

    def render_columns(self, history: History, columns: PixelColumns) -> NDArray[np.uint32]:
        """Return a vertical line in each band from the column's lowest to its highest reading."""
        low, high = _joined_extremes(columns, history.samples)
        top = self._pixel_row(high)[:, self._band].T
        bottom = self._pixel_row(low)[:, self._band].T
        is_ink = (self._row >= top) & (self._row <= bottom)
        return np.where(is_ink, self._ink, self._background)

    def _pixel_row(self, counts: NDArray[np.uint16]) -> NDArray[np.int32]:
        share = (counts - self._low) / (self._high - self._low)
        down = (1.0 - np.clip(share, 0.0, 1.0)) * self._band_height
        return np.asarray(self._top + down, np.int32)


def _joined_extremes(
    columns: PixelColumns, samples: NDArray[np.uint16]
) -> tuple[NDArray[np.uint16], NDArray[np.uint16]]:
    """Return the lowest and highest reading per column.

    They include the sample before the column, so that the lines of adjacent columns join.
    """
    before = max(int(columns.start[0]) - 1, 0)
    low = columns.reduce(samples, np.minimum)
    high = columns.reduce(samples, np.maximum)
    previous = samples[np.maximum(columns.start[:-1] - 1, before)]
    is_joined = ~(columns.missing | np.concatenate([[False], columns.missing[:-1]]))[:, None]
    low = np.where(is_joined, np.minimum(low, previous), low)
    high = np.where(is_joined, np.maximum(high, previous), high)
    return low.astype(np.uint16), high.astype(np.uint16)
