"""The spike raster: SA and RA of each layer of the sensor, newest on the right."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gui.live.scrolling_image import ScrollingImage
from gui.live.spikes.train_rows import TrainRows
from gui.live.store.pixel_columns import PixelColumns
from gui.live.store.timeline import Timeline
from gui.widgets.colours import blend, rgb
from gui.widgets.theme import Theme
from rigctl.session.header import SensorLayout


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

    def render_columns(self, timeline: Timeline, columns: PixelColumns) -> NDArray[np.uint32]:
        """Return ink where the column has a spike."""
        spikes = timeline.spike_columns(columns)
        is_ink = spikes[:, self.rows.order].T[self._row] & self._is_tick
        return np.where(is_ink, self._ink, self._background)
