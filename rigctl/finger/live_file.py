"""Live data of the moving finger in memory that processes share: samples with spikes, the track."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rigctl.engine.live_file import (
    LiveFileReader,
    LiveFileWriter,
    LiveLayout,
    RingColumns,
    RingWindow,
    taxel_columns,
)
from rigctl.finger.board_messages import N_TAXELS
from rigctl.finger.decoder import FingerBlock
from rigctl.finger.trackers.plate_frame import PlatePosition
from rigctl.values import SAMPLE_RATE_HZ

MAGIC = 0x3152_474E_4947_4952  # "RIGINGR1", low byte first
TAXEL_ROWS = 1 << 15
TRACK_ROWS = 1 << 13


def finger_live(n_taxels: int = N_TAXELS) -> LiveLayout:
    """Return the layout of the finger's live data."""
    numbers = ("time_s", "along_mm", "across_mm", "height_mm")
    track: RingColumns = {
        **dict.fromkeys(numbers, np.dtype(np.float64)),
        "valid": np.dtype(np.bool_),
    }
    return LiveLayout(MAGIC, n_taxels, taxel_columns(n_taxels, 1), track)


@dataclass(frozen=True, slots=True)
class TrackWindow(RingWindow):
    """Newest positions of the finger on the plate, mm, float64 (n,); ``valid``: bool (n,)."""

    along_mm: NDArray[np.float64]
    across_mm: NDArray[np.float64]
    height_mm: NDArray[np.float64]
    valid: NDArray[np.bool_]


class FingerLiveWriter(LiveFileWriter):
    """Live data of the finger, as its engine writes them."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, finger_live(), TAXEL_ROWS, TRACK_ROWS)

    def add_block(self, block: FingerBlock, arrived_s: float) -> None:
        """Append samples; the last one was taken when the block arrived."""
        counters = block.counters
        if not len(counters):
            return
        self.add_taxels(
            time_s=arrived_s - (counters[-1] - counters) / SAMPLE_RATE_HZ,
            counters=counters,
            samples=block.readings,
            flags=block.flags,
            spikes=block.spikes,
        )

    def add_position(self, position: PlatePosition) -> None:
        """Append a position."""
        at_s, along_mm, across_mm, height_mm, valid = position
        self._file.other.append(
            1,
            time_s=at_s,
            along_mm=along_mm,
            across_mm=across_mm,
            height_mm=height_mm,
            valid=float(valid),
        )


class FingerLiveReader(LiveFileReader):
    """Live data of the finger, as a window reads them."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, finger_live)

    def track(self, n: int) -> TrackWindow:
        """Return the newest ``n`` positions, or all if there are fewer."""
        first, rows = self._file.other.newest(n)
        return TrackWindow(first, **rows)
