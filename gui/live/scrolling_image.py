"""A picture that scrolls: every pixel column belongs to a span of samples and is drawn once.

A redraw costs what is new, not what is shown: new columns are computed with NumPy into a ring
of columns and the picture is put on the screen in two pieces. Each column shows the minimum
and maximum of its samples (or whether any spike fell into it), so nothing short is ever lost.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QRectF
from PySide6.QtGui import QColor, QImage, QPainter, QTransform
from PySide6.QtWidgets import QGraphicsItem, QStyleOptionGraphicsItem, QWidget

from gui.live.history import SPAN_S, History
from gui.widgets.theme import Theme
from rigctl.values import SAMPLE_RATE_HZ

_T = TypeVar("_T", np.uint8, np.uint16)


@dataclass(frozen=True, slots=True)
class PixelColumns:
    """Neighbouring pixel columns, each standing for the samples ``start[i]:start[i + 1]``.

    ``number``: int64 (k,), absolute column numbers, ascending by one.
    ``start``: int64 (k + 1,), rows of the history.
    ``missing``: bool (k,), columns whose samples were lost.
    """

    number: NDArray[np.int64]
    start: NDArray[np.int64]
    missing: NDArray[np.bool_]

    def reduce(self, values: NDArray[_T], how: np.ufunc) -> NDArray[_T]:
        """One row a column: ``how`` over its samples; an empty column repeats the one before."""
        filled = np.flatnonzero(np.diff(self.start))
        if not len(filled):
            return np.zeros((len(self.number), values.shape[1]), values.dtype)
        first = self.start[0]
        reduced = how.reduceat(values[first : self.start[-1]], self.start[filled] - first, axis=0)
        source = np.searchsorted(filled, np.arange(len(self.number)), side="right") - 1
        return np.asarray(reduced[np.maximum(source, 0)], values.dtype)


def columns_between(
    counters: NDArray[np.int64], first: int, width: int, span_samples: int
) -> PixelColumns:
    """The columns from absolute number ``first`` to the newest sample's.

    A column number is ``counter * width // span_samples``, so that it never moves.
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
    """Rows of history against time, newest at the right; subclasses say what a column shows.

    Its rectangle in plot units is ``-span_s … 0`` by ``0 … n_rows``, row 0 at the top (the
    view that holds it has an inverted y axis).
    """

    def __init__(self, n_rows: int, theme: Theme) -> None:
        super().__init__()
        self.n_rows = n_rows
        self.theme = theme
        self.span_s = float(SPAN_S)
        self._pixels = np.zeros((1, 1), np.uint32)
        self._head = 0
        self._drawn = -1
        self._ratio = 1.0
        self._generation = -1
        self._stale = True

    def set_theme(self, theme: Theme) -> None:
        """Draw everything anew in other colours."""
        self.theme = theme
        self._stale = True

    def set_span(self, span_s: float) -> None:
        """Show another stretch of time."""
        self.prepareGeometryChange()
        self.span_s = span_s
        self._stale = True

    def refresh(self, history: History, width: int, height: int, ratio: float) -> None:
        """Bring the picture up to date for a view of ``width`` × ``height`` logical pixels."""
        shape = (max(1, round(height * ratio)), max(1, round(width * ratio)))
        if self._stale or shape != self._pixels.shape or history.generation != self._generation:
            self._start_anew(shape, ratio, history.generation)
        if len(history):
            self._draw_new(history)
        self.update()

    def boundingRect(self) -> QRectF:
        """The strip's place in plot units."""
        return QRectF(-self.span_s, 0.0, self.span_s, float(self.n_rows))

    def paint(
        self,
        painter: QPainter,
        option: QStyleOptionGraphicsItem,
        widget: QWidget | None = None,
    ) -> None:
        """Put the ring on the screen: what lies behind the head is older and comes first."""
        place = painter.worldTransform().mapRect(self.boundingRect())
        left, top = round(place.left()), round(place.top())
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
        """Pixels of some columns, uint32 (height, k); for subclasses to say."""
        # Qt's metaclass and ABCMeta do not combine, so the method cannot be declared abstract.
        raise NotImplementedError

    def laid_out(self, height: int) -> None:
        """Prepare for pictures of another height; for subclasses that need tables."""

    def _start_anew(self, shape: tuple[int, int], ratio: float, generation: int) -> None:
        self._pixels = np.full(shape, rgb(self.theme.plot), np.uint32)
        self._drawn = -1
        self._ratio = ratio
        self._generation = generation
        self._stale = False
        self.laid_out(shape[0])

    def _draw_new(self, history: History) -> None:
        width, span = self._pixels.shape[1], round(self.span_s * SAMPLE_RATE_HZ)
        counters = history.counters
        self._head = int(counters[-1]) * width // span
        oldest = max(self._head - width + 1, int(counters[0]) * width // span)
        # The newest column may have been drawn half full: begin with it again.
        columns = columns_between(counters, max(oldest, self._drawn), width, span)
        pixels = self.render_columns(history, columns)
        pixels[:, columns.missing] = rgb(self.theme.gap)
        self._clear_skipped(columns)
        self._pixels[:, columns.number % width] = pixels
        self._drawn = self._head

    def _clear_skipped(self, columns: PixelColumns) -> None:
        """Blank the columns between the last drawn and the oldest still in the history."""
        width = self._pixels.shape[1]
        first = int(columns.number[0])
        if self._drawn < 0 or first - self._drawn <= 1:
            return
        skipped = np.arange(max(self._drawn + 1, first - width), first) % width
        self._pixels[:, skipped] = rgb(self.theme.gap)


def rgb(colour: str) -> int:
    """A colour as the 32-bit pixel that QImage's RGB32 wants."""
    return int(QColor(colour).rgb())


def blend(colour: str, background: str, share: float) -> str:
    """``colour`` laid over ``background`` with opacity ``share``."""
    over, under = QColor(colour), QColor(background)
    # PySide6 declares getRgb() to return an object; it is a tuple of four integers.
    mixed = [
        round(share * a + (1 - share) * b)
        for a, b in zip(over.getRgb()[:3], under.getRgb()[:3], strict=True)  # type: ignore[index]
    ]
    return QColor(*mixed).name()
