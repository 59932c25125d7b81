"""A scrolling image: every pixel column belongs to a span of samples and is drawn once.

The cost of a redraw depends only on the new columns: NumPy computes them into a ring of columns,
and Qt paints the ring in two pieces. Each column shows the minimum and maximum of its samples
(or whether it has a spike), so that short events stay visible.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QRectF
from PySide6.QtGui import QColor, QImage, QPainter, QTransform
from PySide6.QtWidgets import QGraphicsItem

from gui.live.history import SPAN_S, History
from gui.widgets.theme import Theme
from rigctl.values import SAMPLE_RATE_HZ

_T = TypeVar("_T", np.uint8, np.uint16)


@dataclass(frozen=True, slots=True)
class PixelColumns:
    """Adjacent pixel columns; column ``i`` shows the samples ``start[i]:start[i + 1]``.

    ``number``: int64 (k,), absolute column numbers, ascending by one.
    ``start``: int64 (k + 1,), rows of the history.
    ``missing``: bool (k,), columns whose samples are lost.
    """

    number: NDArray[np.int64]
    start: NDArray[np.int64]
    missing: NDArray[np.bool_]

    def reduce(self, values: NDArray[_T], ufunc: np.ufunc) -> NDArray[_T]:
        """Return one row per column, reduced by ``ufunc``; an empty column repeats the last."""
        filled = np.flatnonzero(np.diff(self.start))
        if not len(filled):
            return np.zeros((len(self.number), values.shape[1]), values.dtype)
        first = self.start[0]
        reduced = ufunc.reduceat(values[first : self.start[-1]], self.start[filled] - first, axis=0)
        source = np.searchsorted(filled, np.arange(len(self.number)), side="right") - 1
        return np.asarray(reduced[np.maximum(source, 0)], values.dtype)


def columns_between(
    counters: NDArray[np.int64], first: int, width: int, span_samples: int
) -> PixelColumns:
    """Return the columns from absolute number ``first`` to that of the newest sample.

    A column number is ``counter * width // span_samples``, so that it never changes.
    """
    last = int(counters[-1]) * width // span_samples
    number = np.arange(first, last + 1, dtype=np.int64)
    edges = -(-np.arange(first, last + 2, dtype=np.int64) * span_samples // width)
    start = np.searchsorted(counters, edges).astype(np.int64)
    after = np.minimum(start[:-1], len(counters) - 1)
    jump = counters[after] - counters[np.maximum(after - 1, 0)]
    missing = (start[1:] == start[:-1]) & (jump > 1)
    return PixelColumns(number, start, missing)


class ScrollingImage(QGraphicsItem):
    """Rows of history over time, newest on the right; subclasses render the columns.

    Its rectangle in plot units is ``-span_s … 0`` by ``0 … n_rows``, row 0 at the top (its view
    has an inverted y axis).
    """

    def __init__(self, n_rows: int, theme: Theme) -> None:
        super().__init__()
        self.n_rows = n_rows
        self.theme = theme
        self.span_s = float(SPAN_S)
        self._pixels = np.zeros((1, 1), np.uint32)
        self._head = 0
        self._last_drawn = -1
        self._ratio = 1.0
        self._generation = -1
        self._is_stale = True

    def set_theme(self, theme: Theme) -> None:
        """Apply a theme; the next refresh redraws everything."""
        self.theme = theme
        self._is_stale = True

    def set_span(self, span_s: float) -> None:
        """Set the length of the time axis."""
        self.prepareGeometryChange()
        self.span_s = span_s
        self._is_stale = True

    def refresh(self, history: History, width: int, height: int, ratio: float) -> None:
        """Draw the new columns for a view of ``width`` × ``height`` logical pixels."""
        shape = (max(1, round(height * ratio)), max(1, round(width * ratio)))
        if self._is_stale or shape != self._pixels.shape or history.generation != self._generation:
            self._reset(shape, ratio, history.generation)
        if len(history):
            self._draw_new(history)
        self.update()

    def boundingRect(self) -> QRectF:
        """Return the image's rectangle in plot units."""
        return QRectF(-self.span_s, 0.0, self.span_s, float(self.n_rows))

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

    def render_columns(self, history: History, columns: PixelColumns) -> NDArray[np.uint32]:
        """Return the pixels of some columns, uint32 (height, k); subclasses implement it."""
        # Qt's metaclass and ABCMeta do not combine, so the method cannot be declared abstract.
        raise NotImplementedError

    def prepare(self, height: int) -> None:
        """Compute tables for another height or theme; subclasses that need them implement it."""

    def _reset(self, shape: tuple[int, int], ratio: float, generation: int) -> None:
        self._pixels = np.full(shape, rgb(self.theme.plot), np.uint32)
        self._last_drawn = -1
        self._ratio = ratio
        self._generation = generation
        self._is_stale = False
        self.prepare(shape[0])

    def _draw_new(self, history: History) -> None:
        width, span = self._pixels.shape[1], round(self.span_s * SAMPLE_RATE_HZ)
        counters = history.counters
        self._head = int(counters[-1]) * width // span
        oldest = max(self._head - width + 1, int(counters[0]) * width // span)
        # The last column may have been drawn before it was complete: draw it again.
        columns = columns_between(counters, max(oldest, self._last_drawn), width, span)
        pixels = self.render_columns(history, columns)
        pixels[:, columns.missing] = rgb(self.theme.gap)
        self._clear_skipped(columns)
        self._pixels[:, columns.number % width] = pixels
        self._last_drawn = self._head

    def _clear_skipped(self, columns: PixelColumns) -> None:
        """Mark the columns between the last drawn and the oldest in the history as lost."""
        width = self._pixels.shape[1]
        first = int(columns.number[0])
        if self._last_drawn < 0 or first - self._last_drawn <= 1:
            return
        skipped = np.arange(max(self._last_drawn + 1, first - width), first) % width
        self._pixels[:, skipped] = rgb(self.theme.gap)


def rgb(colour: str) -> int:
    """Return a colour as a 32-bit pixel of QImage's RGB32 format."""
    return int(QColor(colour).rgb())


def blend(colour: str, background: str, share: float) -> str:
    """Return ``colour`` over ``background`` with opacity ``share``."""
    over, under = QColor(colour), QColor(background)
    # PySide6 declares getRgb() to return an object; it is a tuple of four integers.
    mixed = [
        round(share * a + (1 - share) * b)
        for a, b in zip(over.getRgb()[:3], under.getRgb()[:3], strict=True)  # type: ignore[index]
    ]
    return QColor(*mixed).name()
