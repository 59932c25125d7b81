"""What the live views show: samples, spikes, force, speed, events and the taxels' ranges."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gui.live.review.marks import EventMarks
from gui.live.store.drum_course import DrumCourse
from gui.live.store.timeline import CAPACITY_S, Timeline
from rigctl.acquisition.live_buffer import LiveReader
from rigctl.encoding.normalisation import FULL_SCALE
from rigctl.values import SAMPLE_RATE_HZ


class LiveData:
    """The last ``capacity`` samples.

    ``low``, ``high``: each taxel's range in counts, float64 (n_taxels,).
    """

    def __init__(self, n_taxels: int, capacity: int = CAPACITY_S * SAMPLE_RATE_HZ) -> None:
        self.timeline = Timeline(capacity, n_taxels, 2 * n_taxels)
        self.drum, self.marks = DrumCourse(), EventMarks()
        self.low = np.zeros(n_taxels)
        self.high = np.full(n_taxels, float(FULL_SCALE))

    def clear(self) -> None:
        """Remove everything, as when another rig is connected."""
        for part in (self.timeline, self.drum, self.marks):
            part.clear()

    def pull(self, live: LiveReader) -> None:
        """Append what the engine wrote since the last pull."""
        self.timeline.pull(live)
        self.drum.pull(live, self.timeline)

    def add_event(self, at_s: float, kind: str, text: str, data: Mapping[str, Any]) -> None:
        """Mark an event of the engine that happens about now, at its time."""
        self.marks.add(float(self.timeline.position_at(at_s)), kind, text, data)

    def reading_at(self, position: int, taxel: int) -> int | None:
        """Return the reading of a taxel, from 0, at a position in counts, None if it is lost."""
        readings = self.samples_before(position, 1)
        return int(readings[0, taxel]) if len(readings) else None

    def samples_before(self, position: int, n: int) -> NDArray[np.uint16]:
        """Return the readings of at most ``n`` samples up to a position, uint16 (k, n_taxels)."""
        return self.timeline.samples.between(*self._rows_before(position, n))

    def spikes_before(self, position: int, n: int) -> NDArray[np.uint8]:
        """Return the spikes of at most ``n`` samples up to a position, uint8 (k, n_rows)."""
        return self.timeline.spikes.between(*self._rows_before(position, n))

    def _rows_before(self, position: int, n: int) -> tuple[int, int]:
        bounds = self.timeline.counters.count_below(np.array([position - n + 1, position + 1]))
        return int(bounds[0]), int(bounds[1])
