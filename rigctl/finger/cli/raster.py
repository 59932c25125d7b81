"""The newest scan's spikes, for ``rigctl watch``."""

from __future__ import annotations

import numpy as np

from rigctl.cli.session_looks import TrialRaster
from rigctl.finger.session import FingerSession


def scan_raster(session: FingerSession, index: int) -> TrialRaster:
    """Return the spikes of a scan, as the board counted them, with its answer in the title."""
    row = session.trial_row(index)
    spikes = session.spikes(index)
    at = np.arange(len(spikes), dtype=np.int32)
    trains = [np.repeat(at, spikes[:, taxel]) for taxel in range(spikes.shape[1])]
    named = f", named {row.predicted}" if row.predicted else ""
    title = f"scan {row.trial_id} ({row.texture}, {row.profile}{named}), {len(spikes)} ms:"
    return TrialRaster(title, [("", trains)], max(1, len(spikes)))
