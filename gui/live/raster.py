"""The 36-row spike raster: SAI, RAI, SAII, RAII, nine taxels each, newest on the right."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gui.live.history import N_ROWS, History
from gui.live.scrolling_image import PixelColumns, ScrollingImage, blend, rgb
from gui.widgets.theme import Theme
from rigctl.values import N_TAXELS

GROUPS = ("SAI", "RAI", "SAII", "RAII")
PER_GROUP = N_TAXELS // 2
ROW_ORDER = np.concatenate(
    [np.arange(0, 9), np.arange(18, 27), np.arange(9, 18), np.arange(27, 36)]
)
"""The encoder's row in each raster row from the top; the encoder has SA 1–18, then RA 1–18."""


def row_label(row: int) -> str:
    """Return the name of a raster row in the paper's numbering: SA-1 … RA-18."""
    encoder_row = int(ROW_ORDER[row])
    return f"{'SA' if encoder_row < N_TAXELS else 'RA'}-{encoder_row % N_TAXELS + 1}"


class Raster(ScrollingImage):
    """One tick per pixel column with at least one spike."""

    def __init__(self, theme: Theme) -> None:
        super().__init__(N_ROWS, theme)

    def prepare(self, height: int) -> None:
        """Assign every pixel row its raster row, ink and background."""
        edges = np.arange(N_ROWS + 1) * height // N_ROWS
        self._row = np.clip(np.searchsorted(edges, np.arange(height), "right") - 1, 0, 35)
        inks = [rgb(self.theme.groups[row // PER_GROUP]) for row in range(N_ROWS)]
        self._ink = np.array(inks, np.uint32)[self._row][:, None]
        shades = [self.theme.plot, blend(self.theme.muted, self.theme.plot, 0.07)]
        backgrounds = [rgb(shades[row // PER_GROUP % 2]) for row in range(N_ROWS)]
        self._background = np.array(backgrounds, np.uint32)[self._row][:, None]
        self._is_tick = np.ones((height, 1), bool)
        if height >= 4 * N_ROWS:
            self._is_tick[edges[:-1]] = False

    def render_columns(self, history: History, columns: PixelColumns) -> NDArray[np.uint32]:
        """Return ink where the column has a spike."""
        spikes = columns.reduce(history.spikes, np.bitwise_or)
        spikes[np.diff(columns.start) == 0] = 0
        is_ink = (spikes[:, ROW_ORDER[self._row]] > 0).T & self._is_tick
        return np.where(is_ink, self._ink, self._background)
