"""A recorded trial as the data of the live views."""

from __future__ import annotations

import numpy as np

from gui.analysis.tasks.task_values import TrialData
from gui.live.live_data import LiveData
from gui.live.live_plots import LivePlots
from rigctl.values import SAMPLE_RATE_HZ


def fill(plots: LivePlots, data: TrialData) -> None:
    """Show a trial in the plots: sample 0 is the first of its window."""
    n, n_taxels = data.samples.shape
    plots.show_data(LiveData(n_taxels, capacity=max(n, 1)), data.layout)
    live = plots.data
    spikes = np.zeros((n, 2 * n_taxels), np.uint8)
    np.add.at(spikes, (data.spike_sample, data.spike_row), 1)
    counters = np.arange(n, dtype=np.int64)
    flags = np.zeros(n, np.uint8)
    live.timeline.append(counters / SAMPLE_RATE_HZ, counters, data.samples, flags, spikes)
    live.low, live.high = data.samples.min(axis=0) * 1.0, data.samples.max(axis=0) * 1.0
    _fill_drum(live, data)


def _fill_drum(live: LiveData, data: TrialData) -> None:
    course = data.course
    if course is None or not np.isfinite(course.speed_s).any():
        return
    known = np.isfinite(course.force_s)
    at_s = course.force_s[known]
    force = course.force_g[known]
    speed = np.interp(at_s, course.speed_s, course.speed_mm_s)
    columns = {
        "force_g": force,
        "force_set_g": np.full(len(at_s), course.planned_g),
        "speed_mm_s": speed,
        "speed_set_mm_s": np.full(len(at_s), course.planned_mm_s),
    }
    live.drum.append(at_s * SAMPLE_RATE_HZ, columns)
