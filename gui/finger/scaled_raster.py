"""The spikes of a scan in scaled time: every sample stands at the way that the finger had made."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QRectF
from PySide6.QtGui import QImage, QPainter, QTransform
from PySide6.QtWidgets import QGraphicsItem

from gui.finger.scan_record import ScanRecord
from gui.live.history import History
from gui.widgets.colours import blend, rgb
from gui.widgets.theme import Theme
from rigctl.finger_values import N_FINGER_TAXELS
from rigctl.values import SAMPLE_RATE_HZ
from rigctl.wire.finger.messages import SampleFlag

SPAN_MM = 210.0
"""The way between the marks, and what a velocity's error may add."""
WINDOW_MM = 10.0


def scan_samples(history: History) -> tuple[NDArray[np.int64], NDArray[np.uint8]]:
    """Return the samples of the newest scan: their numbers in it (n,), and their spikes (n, 9).

    Empty if the scan's first sample is no longer in the history.
    """
    firsts = np.flatnonzero(history.flags & SampleFlag.FIRST)
    if not len(firsts):
        return np.zeros(0, np.int64), np.zeros((0, N_FINGER_TAXELS), np.uint8)
    first = int(firsts[-1])
    outside = np.flatnonzero((history.flags[first:] & SampleFlag.IN_SCAN) == 0)
    end = first + int(outside[0]) if len(outside) else len(history)
    counters = history.counters[first:end]
    return counters - history.counters[first], history.spikes[first:end]


class ScaledRaster(QGraphicsItem):
    """One row a taxel, T1 at the top; a tick is a pixel column with at least one spike.

    Its rectangle in plot units is ``0 … SPAN_MM`` by ``0 … 9``. Only samples of batches whose
    velocity is known have a place: the newest spikes appear at most a batch later.
    """

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self.theme = theme
        self._pixels = np.zeros((1, 1), np.uint32)
        self._ratio = 1.0
        self._drawn: tuple[object, ...] = ()

    def set_theme(self, theme: Theme) -> None:
        """Apply a theme; the next refresh redraws everything."""
        self.theme = theme
        self._drawn = ()

    def refresh(
        self, history: History, record: ScanRecord, width: int, height: int, ratio: float
    ) -> None:
        """Draw the scan for a view of ``width`` × ``height`` logical pixels, if it changed."""
        shape = (max(1, round(height * ratio)), max(1, round(width * ratio)))
        wanted = (shape, ratio, record.version)
        if wanted != self._drawn:
            self._drawn, self._ratio = wanted, ratio
            self._draw(shape, *_placed_spikes(history, record))
            self.update()

    @property
    def ticks(self) -> NDArray[np.bool_]:
        """Which pixel columns of each taxel have a spike, bool (9, columns)."""
        edges = _row_edges(len(self._pixels))
        middles = (edges[:-1] + edges[1:]) // 2
        is_ink: NDArray[np.bool_] = self._pixels[middles] == rgb(self.theme.groups[0])
        return is_ink

    def boundingRect(self) -> QRectF:
        """Return the rectangle in plot units."""
        return QRectF(0.0, 0.0, SPAN_MM, float(N_FINGER_TAXELS))

    def paint(self, painter: QPainter, *_: object) -> None:
        """Paint the pixels."""
        area = painter.worldTransform().mapRect(self.boundingRect())
        height, width = self._pixels.shape
        image = QImage(self._pixels.data, width, height, 4 * width, QImage.Format.Format_RGB32)
        image.setDevicePixelRatio(self._ratio)
        painter.save()
        painter.setWorldTransform(QTransform())
        painter.drawImage(round(area.left()), round(area.top()), image)
        painter.restore()

    def _draw(
        self, shape: tuple[int, int], taxel: NDArray[np.int64], at_mm: NDArray[np.float64]
    ) -> None:
        height, width = shape
        theme = self.theme
        pixels = np.full(shape, rgb(theme.plot), np.uint32)
        edges = _row_edges(height)
        for row in range(1, N_FINGER_TAXELS, 2):
            pixels[edges[row] : edges[row + 1]] = rgb(blend(theme.muted, theme.plot, 0.07))
        windows = np.arange(WINDOW_MM, SPAN_MM, WINDOW_MM)
        pixels[:, (windows / SPAN_MM * width).astype(np.int64)] = rgb(
            blend(theme.muted, theme.plot, 0.35)
        )
        column = (at_mm / SPAN_MM * width).astype(np.int64)
        is_visible = column < width
        for row in range(N_FINGER_TAXELS):
            ink = column[(taxel == row) & is_visible]
            pixels[edges[row] + 1 : edges[row + 1], ink] = rgb(theme.groups[0])
        self._pixels = pixels


def _row_edges(height: int) -> NDArray[np.int64]:
    return np.arange(N_FINGER_TAXELS + 1) * height // N_FINGER_TAXELS


def _placed_spikes(
    history: History, record: ScanRecord
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return taxel (k,) and way in mm (k,) of each spike in the batches that are scaled."""
    numbers, spikes = scan_samples(history)
    edges = np.rint(record.edges_s * SAMPLE_RATE_HZ).astype(np.int64)
    # A scan has started whose first batch is not scaled: the record is of the scan before.
    is_of_record = len(numbers) > 0 and numbers[-1] + 1 >= edges[-1]
    begin, end = np.searchsorted(numbers, edges[[0, -1]]) if is_of_record else (0, 0)
    sample, taxel = np.nonzero(spikes[begin:end])
    return taxel, np.interp(numbers[begin + sample], edges, record.edges_mm)
