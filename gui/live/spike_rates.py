"""Spike rates of the last second: one bar per raster row, beside it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QRectF
from PySide6.QtGui import QColor, QPainter
from PySide6.QtWidgets import QGraphicsItem

from gui.live.history import N_ROWS
from gui.live.raster import PER_GROUP, ROW_ORDER
from gui.widgets.theme import Theme
from rigctl.values import SAMPLE_RATE_HZ

FULL_SCALE_HZ = 300.0
RATE_TICKS_HZ = (0, 100, 200)
WINDOW_S = 1.0


class RateBars(QGraphicsItem):
    """Horizontal bars from 0 to the rate in Hz, in the raster's row order."""

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self.theme = theme
        self.rates_hz = np.zeros(N_ROWS)

    def set_theme(self, theme: Theme) -> None:
        """Apply a theme."""
        self.theme = theme
        self.update()

    def refresh(self, spikes: NDArray[np.uint8]) -> None:
        """Show the rates of the newest second of spikes, uint8 (n, 36) in the encoder's order."""
        newest = spikes[-round(WINDOW_S * SAMPLE_RATE_HZ) :]
        seconds = max(len(newest), 1) / SAMPLE_RATE_HZ
        self.rates_hz = newest.sum(axis=0, dtype=np.int64)[ROW_ORDER] / seconds
        self.update()

    def boundingRect(self) -> QRectF:
        """Return the rectangle of all rows up to the full scale."""
        return QRectF(0.0, 0.0, FULL_SCALE_HZ, float(N_ROWS))

    def paint(self, painter: QPainter, *_: object) -> None:
        """Draw one rectangle per row."""
        for row, rate in enumerate(np.minimum(self.rates_hz, FULL_SCALE_HZ)):
            colour = QColor(self.theme.groups[row // PER_GROUP])
            painter.fillRect(QRectF(0.0, row + 0.12, float(rate), 0.76), colour)
