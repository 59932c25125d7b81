"""Eighteen taxel traces under each other, minimum and maximum of every pixel column."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gui.live.history import History
from gui.live.scrolling_image import PixelColumns, ScrollingImage, blend, rgb
from gui.widgets.theme import Theme
from rigctl.values import N_TAXELS

FULL_SCALE = 1023
PER_LAYER = N_TAXELS // 2


class Traces(ScrollingImage):
    """Each taxel in a band of its own, scaled to its range; the layers differ in colour."""

    def __init__(self, theme: Theme) -> None:
        super().__init__(N_TAXELS, theme)
        self._low = np.zeros(N_TAXELS)
        self._high = np.full(N_TAXELS, float(FULL_SCALE))

    def set_range(self, low: NDArray[np.float64], high: NDArray[np.float64]) -> None:
        """Scale each band to ``low … high`` counts, (18,); redraw if that is visibly other."""
        low, high = np.asarray(low, float), np.asarray(high, float)
        unusable = high - low < 1
        low, high = np.where(unusable, 0.0, low), np.where(unusable, FULL_SCALE, high)
        span = np.maximum(self._high - self._low, 1.0)
        if max(np.abs(low - self._low).max(), np.abs(high - self._high).max()) == 0:
            return
        moved = np.maximum(np.abs(low - self._low), np.abs(high - self._high)) / span
        self._low, self._high = low, high
        self._stale = self._stale or bool(moved.max() > 0.02)

    def laid_out(self, height: int) -> None:
        """Where each band begins and ends, and the colour of every pixel row."""
        edges = np.arange(N_TAXELS + 1) * height // N_TAXELS
        self._top = edges[:-1] + 1
        self._room = np.maximum(np.diff(edges) - 3, 1)
        self._band = np.minimum(np.searchsorted(edges, np.arange(height), "right") - 1, 17)
        colours = [rgb(self.theme.layers[taxel // PER_LAYER]) for taxel in range(N_TAXELS)]
        self._ink = np.array(colours, np.uint32)[self._band][:, None]
        paper = np.full(height, rgb(self.theme.plot), np.uint32)
        paper[edges[PER_LAYER]] = rgb(blend(self.theme.muted, self.theme.plot, 0.5))
        self._paper = paper[:, None]
        self._row = np.arange(height, dtype=np.int32)[:, None]

    def render_columns(self, history: History, columns: PixelColumns) -> NDArray[np.uint32]:
        """A vertical run of ink in each band from the column's least to its greatest reading."""
        before = max(int(columns.start[0]) - 1, 0)
        joined = _with_last_before(columns, history.samples, before)
        top = self._pixel_row(joined[1])[:, self._band].T
        bottom = self._pixel_row(joined[0])[:, self._band].T
        inked = (self._row >= top) & (self._row <= bottom)
        return np.where(inked, self._ink, self._paper)

    def _pixel_row(self, counts: NDArray[np.uint16]) -> NDArray[np.int32]:
        share = (counts - self._low) / (self._high - self._low)
        down = (1.0 - np.clip(share, 0.0, 1.0)) * self._room
        return np.asarray(self._top + down, np.int32)


def _with_last_before(
    columns: PixelColumns, samples: NDArray[np.uint16], before: int
) -> tuple[NDArray[np.uint16], NDArray[np.uint16]]:
    """Least and greatest reading a column, the sample before it included so that lines join."""
    low = columns.reduce(samples, np.minimum)
    high = columns.reduce(samples, np.maximum)
    previous = samples[np.maximum(columns.start[:-1] - 1, before)]
    joins = ~(columns.missing | np.concatenate([[False], columns.missing[:-1]]))[:, None]
    low = np.where(joins, np.minimum(low, previous), low)
    high = np.where(joins, np.maximum(high, previous), high)
    return low.astype(np.uint16), high.astype(np.uint16)
