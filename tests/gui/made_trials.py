"""Trials of the views that no session holds."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gui.analysis.task_values import TrialCourse, TrialData
from gui.analysis.trial_sections import fold_blocks, whole_factor
from rigctl.session.sensor_layout import SensorLayout


def made_trial(
    samples: NDArray[np.uint16],
    rows: NDArray[np.int64],
    at: NDArray[np.int64],
    layout: SensorLayout,
    course: TrialCourse | None = None,
) -> TrialData:
    """Return a trial of these readings with a spike of each of ``rows`` at a sample, as sent."""
    n = len(samples)
    spikes = np.zeros((n, 2 * layout.n_taxels), np.uint8)
    np.add.at(spikes, (at, rows), np.uint8(1))
    overview = fold_blocks([(samples, spikes)], layout.n_taxels, whole_factor(n))
    return TrialData("Trial 1: plate A", overview, layout, course, n_samples=n)
