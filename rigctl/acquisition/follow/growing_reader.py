"""The rows that a recorder appends to a session of any experiment, each once, part by part."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Generic, TypeVar

import numpy as np

from rigctl.session import layout
from rigctl.session.layout import TableLayout, parse_event
from rigctl.session.part import PartReader, StructuredArray
from rigctl.session.session_reader import SessionReader
from rigctl.values import Event

LOOKBACK_SAMPLES = 30_000
"""What a follower shows of the time before it came: the live data hold half a minute."""
LOOKBACK_ROWS = 3_000
"""Of each table that is shown along with the samples."""
MAX_SAMPLES = 10_000
"""In one block: more, after a pause of the disk, come in several."""
_SAMPLES = layout.TAXEL_ARRAYS[0].path

_Session = TypeVar("_Session", bound=SessionReader)


class GrowingReader(Generic[_Session]):
    """What is new in a session since the last :meth:`refresh`.

    At first that is in its last part. Of samples and of ``tables`` it takes the newest that are
    shown, at first and after a time without the folder; of other tables, such as events, each row.
    """

    def __init__(self, session: _Session, tables: tuple[TableLayout, ...]) -> None:
        self.session = session
        self._tables = {table.path for table in tables}
        self._part = session.parts[-1].number
        self._taken: dict[str, int] = {}

    def refresh(self) -> None:
        """Update to what the recorder has flushed since. Raises SessionError, OSError."""
        self.session.refresh()

    def close(self) -> None:
        """Close the files."""
        self.session.close()

    def new_parts(self) -> Iterator[PartReader]:
        """Yield the parts that may have new rows, in their order."""
        for part in [part for part in self.session.parts if part.number >= self._part]:
            if part.number > self._part:
                self._part, self._taken = part.number, {}
            yield part

    def rows(self, part: PartReader, table: TableLayout) -> StructuredArray:
        """Return the new rows of a table."""
        start = self._taken.get(table.path, 0)
        if table.path in self._tables:
            start = max(start, part.n_rows(table) - LOOKBACK_ROWS)
        rows = part.rows(table, start)
        self._taken[table.path] = start + len(rows)
        return rows

    def events(self, part: PartReader) -> list[Event]:
        """Return the new events, without data that no message can hold."""
        found = [parse_event(row, part.path) for row in self.rows(part, layout.EVENTS)]
        return [_plain(event) for event in found]

    def slices(self, part: PartReader) -> list[tuple[int, int]]:
        """Return the first and the last row, excluded, of each block of new samples."""
        end = part.n_samples
        start = max(self._taken.get(_SAMPLES, 0), end - LOOKBACK_SAMPLES)
        self._taken[_SAMPLES] = max(start, end)
        starts = range(start, end, MAX_SAMPLES)
        return [(first, min(end, first + MAX_SAMPLES)) for first in starts]

    def arrived_s(self, part: PartReader, stop: int) -> float:
        """Return when the block of the row before ``stop`` arrived, loop time in s."""
        arrivals = part.rows(layout.ARRIVALS, max(0, part.n_rows(layout.ARRIVALS) - LOOKBACK_ROWS))
        before = arrivals[arrivals["first_row"] < stop]
        return finite(before["arrived_s"][-1]) if len(before) else 0.0


def finite(value: float) -> float:
    """Return a number of a file, 0 for one that no message can hold."""
    return float(value) if np.isfinite(value) else 0.0


def _plain(event: Event) -> Event:
    try:
        json.dumps(event.data, allow_nan=False)
    except ValueError:
        return Event(finite(event.at_s), event.kind, event.text, {})
    return Event(finite(event.at_s), event.kind, event.text, event.data)
