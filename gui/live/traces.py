"""Stacked taxel traces: minimum and maximum of every pixel column."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gui.live.scrolling_image import ScrollingImage
from gui.live.spikes.train_rows import TrainRows
from gui.live.store.pixel_columns import PixelColumns
from gui.live.store.timeline import Timeline
from gui.widgets.colours import blend, rgb
from gui.widgets.theme import Theme
from rigctl.session.header import SensorLayout

FULL_SCALE = 1023


class Traces(ScrollingImage):
    """One band per taxel, scaled to its range; the layers differ in colour."""

    def __init__(self, theme: Theme, layout: SensorLayout) -> None:
        super().__init__(layout.n_taxels, theme)
        self.sensor_layout = layout
        self.taxels = np.arange(layout.n_taxels)
        self._low = np.zeros(layout.n_taxels)
        self._high = np.full(layout.n_taxels, float(FULL_SCALE))

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
        return float(self._low[taxel]), float(self._high[taxel])

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

    def render_columns(self, timeline: Timeline, columns: PixelColumns) -> NDArray[np.uint32]:
        """Return a vertical line in each band from the column's lowest to its highest reading."""
        low, high = timeline.extremes(columns)
        top = self._pixel_row(high).T[self._band]
        bottom = self._pixel_row(low).T[self._band]
        is_ink = (self._row >= top) & (self._row <= bottom)
        return np.where(is_ink, self._ink, self._background)

    def _pixel_row(self, counts: NDArray[np.uint16]) -> NDArray[np.int32]:
        low, high = self._low[self.taxels], self._high[self.taxels]
        share = (counts[:, self.taxels] - low) / (high - low)
        down = (1.0 - np.clip(share, 0.0, 1.0)) * self._band_height
        return np.asarray(self._top + down, np.int32)
