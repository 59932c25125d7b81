"""The rows that a recorder appends to a session of the drum, read as they come."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.acquisition.follow.growing_reader import GrowingReader
from rigctl.session import layout
from rigctl.session.part import PartReader, StructuredArray
from rigctl.session.session import Session
from rigctl.values import Block, Event


class NewRows(NamedTuple):
    """New rows of one part: of the taxels, the drum and the load cell, and events."""

    part: int
    blocks: list[Block]
    polls: StructuredArray
    loadcell: StructuredArray
    events: list[Event]


class GrowingSession(GrowingReader[Session]):
    """A session's new rows since the last :meth:`refresh`. Raises SessionError where it is damaged.

    At first these are the newest rows of the last part.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(Session.open(path), (layout.DRUM, layout.LOADCELL))

    def take_rows(self) -> Iterator[NewRows]:
        """Yield the rows since the last call, part by part."""
        for part in self.new_parts():
            yield NewRows(
                part.number,
                [self._block(part, start, stop) for start, stop in self.slices(part)],
                self.rows(part, layout.DRUM),
                self.rows(part, layout.LOADCELL),
                self.events(part),
            )

    def _block(self, part: PartReader, start: int, stop: int) -> Block:
        values = {a.path: part.read(a.path, start, stop) for a in layout.TAXEL_ARRAYS}
        samples, counters, flags, edges = values.values()
        return Block(counters, samples, flags, edges, (), self.arrived_s(part, stop))


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
