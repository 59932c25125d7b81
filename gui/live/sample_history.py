"""The last eleven minutes of samples and spikes, with all that views ask about them.

Positions on the time axis are sample numbers: the board's counters, which go on where the board
restarted and began anew.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.encoder.reading import conductance
from rigctl.engine.live_file import LiveReader, Ring
from rigctl.finger.live_file import FingerLiveReader
from rigctl.values import SAMPLE_RATE_HZ

SPAN_S = 10


@dataclass(frozen=True, slots=True)
class PixelColumns:
    """Adjacent pixel columns; column ``i`` shows the rows ``start[i]:start[i + 1]``.

    ``number``: int64 (k,), absolute column numbers, ascending by one.
    ``start``: int64 (k + 1,), row numbers.
    ``missing``: bool (k,), columns whose samples are lost.
    ``blank``: bool (k,), columns before the first and after the last sample.
    ``samples_a_column``: length of a column.
    """

    number: NDArray[np.int64]
    start: NDArray[np.int64]
    missing: NDArray[np.bool_]
    blank: NDArray[np.bool_]
    samples_a_column: float


def reduce_columns(start: NDArray[np.int64], values: NDArray[Any], ufunc: np.ufunc) -> NDArray[Any]:
    """Return one row per column, reduced by ``ufunc``; an empty column repeats the last one.

    ``start``: int64 (k + 1,), ascending; ``values``: the rows ``start[0]:start[-1]``.
    """
    filled = np.flatnonzero(start[1:] != start[:-1])
    if not len(filled):
        return np.zeros((len(start) - 1, values.shape[1]), values.dtype)
    reduced = ufunc.reduceat(values, start[filled] - start[0], axis=0)
    source = np.searchsorted(filled, np.arange(len(start) - 1), side="right") - 1
    return np.asarray(reduced[np.maximum(source, 0)], values.dtype)


@dataclass(frozen=True, slots=True)
class TimeWindow:
    """Positions in samples: the last one shown, how many are shown, and that of time 0."""

    right: int
    span: int
    origin: int

    @property
    def left(self) -> int:
        """The first position shown."""
        return self.right - self.span

    @property
    def left_s(self) -> float:
        """The beginning of the time axis."""
        return (self.left - self.origin) / SAMPLE_RATE_HZ

    @property
    def right_s(self) -> float:
        """The end of the time axis."""
        return (self.right - self.origin) / SAMPLE_RATE_HZ

    def position_of(self, share: float) -> int:
        """Return the position at a share of the width, 0 at the left."""
        return self.left + round(share * self.span)


FACTORS = (16, 64)
"""Samples a block, of each level."""
BLOCKS_A_COLUMN = 4
"""A level is used where a pixel column has at least as many of its blocks.

A block belongs to the column in which it begins, so a sample stands at most a quarter of a column
beside its place.
"""


class PyramidLevel:
    """Blocks of ``factor`` samples: the minimum, the maximum, and whether a spike fell into it."""

    def __init__(self, factor: int, capacity: int, n_taxels: int, n_rows: int) -> None:
        self.factor = factor
        n_blocks = max(1, capacity // factor)
        self.low = Ring(n_blocks, np.dtype((np.uint16, n_taxels)))
        self.high = Ring(n_blocks, np.dtype((np.uint16, n_taxels)))
        self.spikes = Ring(n_blocks, np.dtype((np.uint8, n_rows)))

    def clear(self) -> None:
        """Remove all blocks."""
        for ring in (self.low, self.high, self.spikes):
            ring.clear()

    def extend(self, low: Ring, high: Ring, spikes: Ring, rows_a_block: int) -> None:
        """Append the blocks that are complete in the finer rows, ``rows_a_block`` to a block."""
        first, end = self.low.end, low.end // rows_a_block
        if end <= first:
            return
        pairs = ((self.low, low, np.minimum), (self.high, high, np.maximum))
        for ring, finer, ufunc in (*pairs, (self.spikes, spikes, np.maximum)):
            ring.append(_blocks(finer, ufunc, first, end, rows_a_block))


def _blocks(finer: Ring, ufunc: np.ufunc, first: int, end: int, factor: int) -> NDArray[Any]:
    """Return the blocks ``first`` … ``end - 1``; those whose rows are gone repeat the oldest."""
    rows = finer.between(first * factor, end * factor)
    n_gone = (end - first) - len(rows) // factor
    rows = rows[len(rows) % factor :]
    blocks = ufunc.reduce(rows.reshape(-1, factor, rows.shape[1]), axis=1)
    return np.concatenate([np.repeat(blocks[:1], n_gone, axis=0), blocks]) if n_gone else blocks


class Pyramid:
    """The levels over the rings of readings and spikes."""

    def __init__(self, capacity: int, n_taxels: int, n_rows: int) -> None:
        self.levels = [PyramidLevel(factor, capacity, n_taxels, n_rows) for factor in FACTORS]

    def clear(self) -> None:
        """Remove all blocks."""
        for level in self.levels:
            level.clear()

    def extend(self, samples: Ring, spikes: Ring) -> None:
        """Add the new samples."""
        low, high, below = samples, samples, 1
        for level in self.levels:
            level.extend(low, high, spikes, level.factor // below)
            low, high, spikes, below = level.low, level.high, level.spikes, level.factor

    def level_for(self, samples_a_column: float) -> PyramidLevel | None:
        """Return the coarsest level that is fine enough, or None where single samples are."""
        fits = [s for s in self.levels if s.factor * BLOCKS_A_COLUMN <= samples_a_column]
        return fits[-1] if fits else None


CAPACITY_S = 660

Recode = Callable[[NDArray[np.int64], NDArray[np.uint16], NDArray[np.uint8]], NDArray[np.uint8]]
"""Spikes uint8 (n, n_rows) of n samples: their positions, readings and bits of the wire."""
Extremes = tuple[NDArray[np.uint16], NDArray[np.uint16]]


class SampleHistory:
    """Samples and spikes in order of arrival; ``generation`` changes when they are removed.

    Rings, a row each sample: ``counters`` int64 (position), ``time_s`` float64 (engine's time),
    ``samples`` uint16 (n_taxels,), ``flags`` uint8, ``spikes`` uint8 (n_rows,) in the encoder's
    order. ``recode``: replaces the spikes of samples that arrive, None for those of the engine.
    ``inputs``: the input of each taxel to store conductances of the counts that arrive, else empty.
    """

    def __init__(
        self,
        n_taxels: int,
        n_rows: int,
        capacity: int = CAPACITY_S * SAMPLE_RATE_HZ,
    ) -> None:
        self.capacity = capacity
        self.counters = Ring(capacity, np.dtype(np.int64))
        self.time_s = Ring(capacity, np.dtype(np.float64))
        self.samples = Ring(capacity, np.dtype((np.uint16, n_taxels)))
        self.flags = Ring(capacity, np.dtype(np.uint8))
        self.spikes = Ring(capacity, np.dtype((np.uint8, n_rows)))
        self._pyramid = Pyramid(capacity, n_taxels, n_rows)
        self.generation = 0
        self.recode: Recode | None = None
        self.inputs: tuple[int, ...] = ()
        self._columns: PixelColumns | None = None
        self._columns_at = (0, 0, 0, 0, 0, 0)
        self.clear()

    def clear(self) -> None:
        """Remove all samples, as after a reconnection."""
        for ring in (self.counters, self.time_s, self.samples, self.flags, self.spikes):
            ring.clear()
        self._pyramid.clear()
        self._head = 0
        self._offset = 0
        self.newest = 0
        self.newest_s = 0.0
        self.generation += 1

    def __len__(self) -> int:
        return self.counters.end - self.counters.first

    @property
    def head(self) -> int:
        """Rows that the engine has written and this took, or came too late for."""
        return self._head

    @property
    def oldest(self) -> int:
        """Position of the oldest sample."""
        if not len(self):
            return 0
        return int(self.counters.between(self.counters.first, self.counters.first + 1)[0])

    def pull(self, live: LiveReader | FingerLiveReader) -> int:
        """Append what the engine wrote since the last pull; return the number of new samples."""
        if live.taxel_head <= self._head:
            return 0
        window = live.taxels_since(max(self._head, live.taxel_head - self.capacity))
        self._head = window.first + len(window)
        return self.append(
            window.time_s, window.counters, window.samples, window.flags, window.spikes
        )

    def append(
        self,
        time_s: NDArray[np.float64],
        counters: NDArray[np.int64],
        samples: NDArray[np.uint16],
        flags: NDArray[np.uint8],
        spikes: NDArray[np.uint8],
    ) -> int:
        """Append n samples, each array (n, …), oldest first; return n."""
        if len(counters):
            positions = self._positions(counters, time_s)
            self.counters.append(positions)
            self.time_s.append(time_s)
            self.samples.append(conductance(samples, self.inputs) if self.inputs else samples)
            self.flags.append(flags)
            if self.recode is not None:
                spikes = self.recode(positions, samples, flags)
            self.spikes.append(spikes)
            self._pyramid.extend(self.samples, self.spikes)
            self.newest, self.newest_s = int(positions[-1]), float(time_s[-1])
        return len(counters)

    def position_at(self, time_s: NDArray[np.float64] | float) -> NDArray[np.float64]:
        """Return the positions of engine times about now, float64, by the newest sample."""
        return self.newest + (np.asarray(time_s, float) - self.newest_s) * SAMPLE_RATE_HZ

    def columns(self, first: int, last: int, width: int, span: int) -> PixelColumns:
        """Return the pixel columns with absolute numbers ``first`` … ``last``.

        A column number is ``position * width // span`` (pixels, samples), so that it never changes.
        Traces and raster of one redraw have the same columns, which are computed once.
        """
        place = (first, last, width, span, self.counters.end, self.generation)
        if self._columns is None or place != self._columns_at:
            self._columns, self._columns_at = self._new_columns(first, last, width, span), place
        return self._columns

    def _new_columns(self, first: int, last: int, width: int, span: int) -> PixelColumns:
        number = np.arange(first, last + 1, dtype=np.int64)
        edges = -(-np.arange(first, last + 2, dtype=np.int64) * span // width)
        start = self.counters.count_below(edges)
        after = np.clip(start[:-1], self.counters.first, self.counters.end - 1)
        before = np.maximum(after - 1, self.counters.first)
        jump = self.counters.take(after) - self.counters.take(before)
        missing = (start[1:] == start[:-1]) & (jump > 1)
        blank = (number < self.oldest * width // span) | (number > self.newest * width // span)
        return PixelColumns(number, start, missing & ~blank, blank, span / width)

    def extremes(self, columns: PixelColumns) -> Extremes:
        """Return the lowest and highest readings of each column, uint16 (k, n_taxels) each.

        They include the sample before the column, so that the lines of adjacent columns join.
        """
        level = self._pyramid.level_for(columns.samples_a_column)
        if level is None:
            start = columns.start
            rows = self.samples.between(int(start[0]), int(start[-1]))
            low, high = (reduce_columns(start, rows, fold) for fold in (np.minimum, np.maximum))
        else:
            start = np.clip(-(-columns.start // level.factor), level.low.first, level.low.end)
            place = int(start[0]), int(start[-1])
            low = reduce_columns(start, level.low.between(*place), np.minimum)
            high = reduce_columns(start, level.high.between(*place), np.maximum)
        return self._join(columns, low, high)

    def spike_columns(self, columns: PixelColumns) -> NDArray[np.bool_]:
        """Return whether each row has a spike in each column, bool (k, n_rows)."""
        level = self._pyramid.level_for(columns.samples_a_column)
        if level is None:
            ring, start = self.spikes, columns.start
        else:
            ring = level.spikes
            start = np.clip(-(-columns.start // level.factor), ring.first, ring.end)
        rows = ring.between(int(start[0]), int(start[-1]))
        spikes = reduce_columns(start, rows, np.maximum)
        spikes[start[1:] == start[:-1]] = 0
        return spikes > 0

    def _join(
        self, columns: PixelColumns, low: NDArray[np.uint16], high: NDArray[np.uint16]
    ) -> Extremes:
        rows = columns.start[:-1] - 1
        previous = self.samples.take(np.clip(rows, self.samples.first, self.samples.end - 1))
        apart = columns.missing | np.concatenate([[False], columns.missing[:-1]])
        apart |= (rows < columns.start[0] - 1) | (rows < self.samples.first) | columns.blank
        joined = ~apart[:, None]
        low = np.where(joined, np.minimum(low, previous), low)
        high = np.where(joined, np.maximum(high, previous), high)
        return low, high

    def _positions(
        self, counters: NDArray[np.int64], time_s: NDArray[np.float64]
    ) -> NDArray[np.int64]:
        """Return ascending positions of counters, which begin anew when the board restarts."""
        if not len(self):
            self._offset = 0
        positions = counters + self._offset
        rows = [*(np.flatnonzero(positions[1:] <= positions[:-1]) + 1)]
        if len(self) and positions[0] <= self.newest:
            rows.insert(0, 0)
        for row in rows:
            before = positions[row - 1] if row else self.newest
            before_s = time_s[row - 1] if row else self.newest_s
            missed = max(1, round((time_s[row] - before_s) * SAMPLE_RATE_HZ))
            shift = int(before) + missed - int(positions[row])
            positions[row:] += shift
            self._offset += shift
        return positions
