"""Read a session of the moving finger: cut its scans, also while a writer appends to it."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from rigctl.encoder.normalisation import Normalisation
from rigctl.errors import SessionError
from rigctl.finger.layout import (
    BATCHES,
    FINGER_LAYOUT,
    LATENCIES,
    PREDICTIONS,
    SPIKES,
    TRACK,
    WINDOWS,
    parse_finger_trial,
    parse_prediction,
)
from rigctl.finger.values import FingerTrialRow, PredictionRow
from rigctl.session.header import SessionHeader
from rigctl.session.layout import ARRIVALS, COUNTER, SessionLayout, TableLayout
from rigctl.session.part import StructuredArray
from rigctl.session.session_reader import SessionReader
from rigctl.values import SAMPLE_RATE_HZ

LONGEST_SCAN_MS = 10_000_000


class FingerSession(SessionReader):
    """Reader of a session of the moving finger.

    Rows of tables are structured arrays with the columns of ``docs/reference/session.md``.
    """

    layout: ClassVar[SessionLayout] = FINGER_LAYOUT

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._tables: dict[tuple[int, str], StructuredArray] = {}

    def refresh(self) -> None:
        """Update to the last flush: new rows and new parts."""
        super().refresh()
        self._tables.clear()

    @property
    def latencies(self) -> StructuredArray:
        """All rows of /latencies, with the number of their ``part``."""
        return self._join(LATENCIES)

    @property
    def slides(self) -> int:
        """Slides of the finger so far; those of a missing part count by the scans after it."""
        return max(len(self.trials), int(self.trials["scan"].max(initial=0)))

    def trial_row(self, index: int) -> FingerTrialRow:
        """Return one attempt."""
        return parse_finger_trial(self.trials[index])

    def normalisation(self, index: int) -> Normalisation:
        """Return the ranges that the board used in a trial; the whole range if none was set."""
        return board_ranges(self._part(int(self.trials[index]["part"])).header)

    def spikes(self, index: int) -> NDArray[np.uint8]:
        """Return the board's spikes, uint8 (n, 9), a row for each row of :meth:`samples`."""
        part, start, stop = self._rows_of(index)
        return part.read(SPIKES, start, stop)

    def counters(self, index: int) -> NDArray[np.int64]:
        """Return the board's counters of the samples, int64 (n,); they jump at lost samples."""
        part, start, stop = self._rows_of(index)
        return part.read(COUNTER, start, stop)

    def scan_start_s(self, index: int) -> float:
        """Return the loop time of a trial's first sample, by the earliest arrival in its scan.

        Nothing arrives before its last sample; most blocks arrive a little later. Raises
        SessionError for a trial without samples, and for times that are no numbers.
        """
        part, start, stop = self._rows_of(index)
        arrivals = self._rows(ARRIVALS, part.number)
        first_row = arrivals["first_row"]
        last_row = np.append(first_row[1:], part.n_samples) - 1
        inside = (last_row >= start) & (first_row < stop)
        if stop <= start or not inside.any():
            trial_id = int(self.trials[index]["trial_id"])
            raise SessionError(f"trial {trial_id} of {self.path} has no samples: name another one")
        arrived_s = arrivals["arrived_s"][inside]
        if not np.isfinite(arrived_s).all():
            raise SessionError(f"{part.path}: arrived_s of {ARRIVALS.path} is no number")
        newest = np.minimum(last_row[inside], stop - 1) - start
        since = part.read(COUNTER, start, stop)[newest] - int(self.trials[index]["first_counter"])
        return float(np.min(arrived_s - since / SAMPLE_RATE_HZ))

    def scan_spikes(self, index: int) -> NDArray[np.uint8]:
        """Return the spikes of every millisecond of a scan, uint8 (n, 9), 0 for lost samples.

        n is that of the board's batches: ``count``, and samples that the board lost directly before
        the first one. :func:`rigctl.finger.scaled_time.scale_windows` takes them with
        :meth:`velocities_um_s`.
        """
        row = self.trials[index]
        n_scanned = max(int(row["count"]), int(self.batches(index)["samples"].sum(dtype=np.int64)))
        lost_first = n_scanned - int(row["count"])
        at = self.counters(index) - int(row["first_counter"]) + lost_first
        if n_scanned > LONGEST_SCAN_MS or ((at < 0) | (at >= n_scanned)).any():
            raise SessionError(
                f"{self.path} is damaged: trial {row['trial_id']} has samples outside its scan"
            )
        spikes = np.zeros((n_scanned, self.header.n_taxels), np.uint8)
        spikes[at] = self.spikes(index)
        return spikes

    def velocities_um_s(self, index: int) -> NDArray[np.int64]:
        """Return the velocity that the board used in each batch, int64 (batches,), µm/s."""
        velocities: NDArray[np.int64] = self.batches(index)["velocity_um_s"]
        return velocities

    def track(self, index: int) -> StructuredArray:
        """Return the rows of /track between an attempt's start and its end."""
        row = self.trials[index]
        rows = self._rows(TRACK, int(row["part"]))
        inside: StructuredArray = rows[
            (rows["at_s"] >= row["started_s"]) & (rows["at_s"] <= row["ended_s"])
        ]
        return inside

    def batches(self, index: int) -> StructuredArray:
        """Return the rows of /batches of a trial's scan."""
        return self._scan_rows(BATCHES, index)

    def windows(self, index: int) -> StructuredArray:
        """Return the rows of /windows of a trial's scan; ``spike_counts`` returns its counts."""
        return self._scan_rows(WINDOWS, index)

    def predictions(self, index: int) -> tuple[PredictionRow, ...]:
        """Return the answers during a trial's scan, in the order of time."""
        path = self._part(int(self.trials[index]["part"])).path
        rows = self._scan_rows(PREDICTIONS, index)
        return tuple(parse_prediction(row, path) for row in rows)

    def _rows(self, table: TableLayout, number: int) -> StructuredArray:
        """Return a part's table, read once: trials take their rows out of it by scan or time."""
        key = number, table.path
        if key not in self._tables:
            self._tables[key] = self._part(number).rows(table)
        return self._tables[key]

    def _scan_rows(self, table: TableLayout, index: int) -> StructuredArray:
        row = self.trials[index]
        rows = self._rows(table, int(row["part"]))
        own: StructuredArray = rows[(rows["scan"] == row["scan"]) & (row["first_counter"] >= 0)]
        return own


def board_ranges(header: SessionHeader) -> Normalisation:
    """Return the ranges on the board in a part; the converter's whole range if none was set."""
    if not header.taxel_low:
        return Normalisation.full_scale(header.n_taxels)
    low, high = np.array(header.taxel_low, np.uint16), np.array(header.taxel_high, np.uint16)
    return Normalisation(low, high, "the board's ranges")
