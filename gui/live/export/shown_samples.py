"""Take what the views show out of the live data."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gui.live.export.table_file import COUNTS, ShownSamples
from gui.live.live_data import LiveData
from gui.live.store.time_window import TimeWindow
from rigctl.encoding.reading import Reading


def shown_samples(
    data: LiveData, window: TimeWindow, taxels: Sequence[int], *, simulated: bool = False
) -> ShownSamples:
    """Return copies of the samples in a window, of these taxels from 0."""
    timeline = data.timeline
    bounds = timeline.counters.count_below(np.array([window.left, window.right + 1]))
    rows = int(bounds[0]), int(bounds[1])
    position = timeline.counters.between(*rows).copy()
    spikes = timeline.spikes.between(*rows)
    n_taxels = spikes.shape[1] // 2
    trains = [*taxels, *(n_taxels + taxel for taxel in taxels)]
    origin = "SIMULATED, " if simulated else ""
    title = f"rigctl, live views, {origin}{len(position)} samples at 1000 Hz"
    return ShownSamples(
        title,
        timeline.time_s.between(*rows).copy(),
        position,
        timeline.samples.between(*rows)[:, list(taxels)],
        spikes[:, trains],
        tuple(taxels),
        data.drum.held_at(position),
        COUNTS if data.reading is Reading.COUNTS else data.reading.unit,
    )
