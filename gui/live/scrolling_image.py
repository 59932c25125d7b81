"""A scrolling image: every pixel column belongs to a span of samples and is drawn once.

The cost of a redraw depends only on the columns that came into view, on the right while samples
arrive, on either side while the user scrolls: NumPy computes them into a ring of columns, and Qt
paints the ring in two pieces. Each column shows the minimum and maximum of its samples (or whether
it has a spike), so that short events stay visible.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QRectF
from PySide6.QtGui import QImage, QPainter, QTransform
from PySide6.QtWidgets import QGraphicsItem

from gui.live.history import SPAN_S
from gui.live.timeline import PixelColumns, Timeline, TimeWindow
from gui.widgets.colours import rgb
from gui.widgets.theme import Theme
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
        self._source: tuple[Timeline | None, int] = (None, -1)
        self._is_stale = True

    def set_theme(self, theme: Theme) -> None:
        """Apply a theme; the next refresh redraws everything."""
        self.theme = theme
        self._is_stale = True

    def refresh(
        self, timeline: Timeline, window: TimeWindow, width: int, height: int, ratio: float
    ) -> None:
        """Draw the columns that are new in a view of ``width`` × ``height`` logical pixels."""
        shape = (max(1, round(height * ratio)), max(1, round(width * ratio)))
        source = (timeline, timeline.generation)
        if shape != self._pixels.shape or source != self._source:
            self._is_stale = True
        if self._is_stale or window.span != self.shown.span:
            self._reset(shape, ratio, source)
        if (window.left_s, window.span) != (self.shown.left_s, self.shown.span):
            self.prepareGeometryChange()
        self.shown = window
        self._head = window.right * shape[1] // window.span
        if len(timeline):
            self._draw_new(timeline)
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

    def render_columns(self, timeline: Timeline, columns: PixelColumns) -> NDArray[np.uint32]:
        """Return the pixels of some columns, uint32 (height, k); subclasses implement it."""
        # Qt's metaclass and ABCMeta do not combine, so the method cannot be declared abstract.
        raise NotImplementedError

    def prepare(self, height: int) -> None:
        """Compute tables for another height or theme; subclasses that need them implement it."""

    def _reset(self, shape: tuple[int, int], ratio: float, source: tuple[Timeline, int]) -> None:
        is_prepared = not self._is_stale
        self._pixels = np.full(shape, rgb(self.theme.plot), np.uint32)
        self._drawn = (0, -1)
        self._ratio = ratio
        self._source = source
        self._is_stale = False
        if not is_prepared:
            self.prepare(shape[0])

    def _draw_new(self, timeline: Timeline) -> None:
        """Draw the columns in view that are not drawn, or were drawn before all samples came."""
        width = self._pixels.shape[1]
        first, last = self._head - width + 1, self._head
        drawn_first, drawn_last = self._drawn
        newest = timeline.newest * width // self.shown.span
        if drawn_first > last or drawn_last < first or drawn_first > drawn_last:
            self._draw(timeline, first, last)
        else:
            if first < drawn_first:
                self._draw(timeline, first, drawn_first - 1)
            # Where the right edge stands still, columns behind the newest are blank already.
            end = min(last, newest) if last == self._last else last
            if end > drawn_last:
                self._draw(timeline, drawn_last + 1, end)
        self._last = last
        self._drawn = (first, min(last, newest - 1))

    def _draw(self, timeline: Timeline, first: int, last: int) -> None:
        width = self._pixels.shape[1]
        columns = timeline.columns(first, last, width, self.shown.span)
        pixels = self.render_columns(timeline, columns)
        pixels[:, columns.missing] = rgb(self.theme.gap)
        pixels[_STRIPE_AT::_STRIPE_STEP, columns.missing] = rgb(self.theme.bad)
        pixels[:, columns.blank] = rgb(self.theme.plot)
        at, n = first % width, last - first + 1
        n_before_seam = min(n, width - at)
        self._pixels[:, at : at + n_before_seam] = pixels[:, :n_before_seam]
        self._pixels[:, : n - n_before_seam] = pixels[:, n_before_seam:]
