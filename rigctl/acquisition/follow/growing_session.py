"""The rows that a recorder appends to a session, read as they come."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.session.format import layout
from rigctl.session.format.data_sets import TableLayout
from rigctl.session.format.table_rows import parse_event
from rigctl.session.read.part import PartReader, StructuredArray
from rigctl.session.read.session import Session
from rigctl.values import Block, Event

LOOKBACK_SAMPLES = 30_000
"""What a follower shows of the time before it came: the live data hold half a minute."""
LOOKBACK_ROWS = 3_000
"""Of polls and of load-cell samples."""
MAX_SAMPLES = 10_000
"""In one block: more, after a pause of the disk, come in several."""


class NewRows(NamedTuple):
    """New rows of one part: of the taxels, the drum and the load cell, and events."""

    blocks: list[Block]
    polls: StructuredArray
    loadcell: StructuredArray
    events: list[Event]


class GrowingSession:
    """A session's new rows since the last :meth:`refresh`. Raises SessionError where it is damaged.

    At first these are the newest rows of the last part.
    """

    def __init__(self, path: Path) -> None:
        self.session = Session.open(path)
        self._part = self.session.parts[-1].number
        self._taken: dict[str, int] = {}
        part = self.session.parts[-1]
        self._start_at(layout.TAXEL_ARRAYS[0].path, part.n_samples - LOOKBACK_SAMPLES)
        for table in (layout.DRUM, layout.LOADCELL):
            self._start_at(table.path, part.n_rows(table) - LOOKBACK_ROWS)

    def refresh(self) -> None:
        """Update to what the recorder has flushed since."""
        self.session.refresh()

    def close(self) -> None:
        """Close the files."""
        self.session.close()

    def take_rows(self) -> Iterator[NewRows]:
        """Yield the rows since the last call, part by part."""
        for part in [part for part in self.session.parts if part.number >= self._part]:
            if part.number > self._part:
                self._part, self._taken = part.number, {}
            events = self._rows(part, layout.EVENTS)
            yield NewRows(
                self._blocks(part),
                self._rows(part, layout.DRUM),
                self._rows(part, layout.LOADCELL),
                [parse_event(row, part.path) for row in events],
            )

    def _start_at(self, path: str, row: int) -> None:
        self._taken[path] = max(0, row)

    def _rows(self, part: PartReader, table: TableLayout) -> StructuredArray:
        start = self._taken.get(table.path, 0)
        rows = part.rows(table, start)
        self._taken[table.path] = start + len(rows)
        return rows

    def _blocks(self, part: PartReader) -> list[Block]:
        path = layout.TAXEL_ARRAYS[0].path
        start, end = self._taken.get(path, 0), part.n_samples
        self._taken[path] = max(start, end)
        return [
            self._block(part, first, min(end, first + MAX_SAMPLES))
            for first in range(start, end, MAX_SAMPLES)
        ]

    def _block(self, part: PartReader, start: int, stop: int) -> Block:
        values = {a.path: part.read(a.path, start, stop) for a in layout.TAXEL_ARRAYS}
        samples, counters, flags, edges = values.values()
        return Block(counters, samples, flags, edges, (), self._arrived_s(part, stop))

    def _arrived_s(self, part: PartReader, stop: int) -> float:
        """Return when the block of the row before ``stop`` arrived, loop time in s."""
        arrivals = part.rows(layout.ARRIVALS, max(0, part.n_rows(layout.ARRIVALS) - LOOKBACK_ROWS))
        before = arrivals[arrivals["first_row"] < stop]
        return float(before["arrived_s"][-1]) if len(before) else 0.0


def loadcell_times(loadcell: StructuredArray, polls: StructuredArray) -> NDArray[np.float64]:
    """Return the loop time of load-cell samples, float64 (n,) s, by the poll that brought each."""
    brought = _poll_of(loadcell, polls)
    delay_s = polls["at_s"][brought] - polls["board_time_us"][brought] / 1e6
    times: NDArray[np.float64] = loadcell["board_time_us"] / 1e6 + delay_s
    return times


def at_loadcell(
    column: str, loadcell: StructuredArray, polls: StructuredArray
) -> NDArray[np.float64]:
    """Return a column of the polls at each load-cell sample, float64 (n,)."""
    values: NDArray[np.float64] = polls[column][_poll_of(loadcell, polls)].astype(np.float64)
    return values


def _poll_of(loadcell: StructuredArray, polls: StructuredArray) -> NDArray[np.intp]:
    after = np.searchsorted(polls["board_time_us"], loadcell["board_time_us"])
    return np.minimum(after, len(polls) - 1)
