"""The 36-row spike raster: SAI, RAI, SAII, RAII, nine taxels each, newest at the right."""

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
"""Encoder row shown in each row from the top; the encoder counts SA 1–18, then RA 1–18."""


def row_label(shown: int) -> str:
    """Name of a shown row by the paper's numbering: SA-1 … RA-18."""
    source = int(ROW_ORDER[shown])
    return f"{'SA' if source < N_TAXELS else 'RA'}-{source % N_TAXELS + 1}"


class Raster(ScrollingImage):
    """One tick a spike; a column in which several fell is as dark as one."""

    def __init__(self, theme: Theme) -> None:
        super().__init__(N_ROWS, theme)

    def laid_out(self, height: int) -> None:
        """Which row every pixel row belongs to, its ink, and the paper between."""
        edges = np.arange(N_ROWS + 1) * height // N_ROWS
        self._row_of = np.clip(np.searchsorted(edges, np.arange(height), "right") - 1, 0, 35)
        inks = [rgb(self.theme.groups[row // PER_GROUP]) for row in range(N_ROWS)]
        self._ink = np.array(inks, np.uint32)[self._row_of][:, None]
        shades = [self.theme.plot, blend(self.theme.muted, self.theme.plot, 0.07)]
        papers = [rgb(shades[row // PER_GROUP % 2]) for row in range(N_ROWS)]
        self._paper = np.array(papers, np.uint32)[self._row_of][:, None]
        self._inside = np.ones((height, 1), bool)
        if height >= 4 * N_ROWS:
            self._inside[edges[:-1]] = False

    def render_columns(self, history: History, columns: PixelColumns) -> NDArray[np.uint32]:
        """Ink where a spike fell into the column."""
        fired = columns.reduce(history.spikes, np.bitwise_or)
        fired[np.diff(columns.start) == 0] = 0
        lit = (fired[:, ROW_ORDER[self._row_of]] > 0).T & self._inside
        return np.where(lit, self._ink, self._paper)
