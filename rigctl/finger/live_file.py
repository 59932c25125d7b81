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
class FingerWindow(RingWindow):
    """Newest samples of the finger.

    ``counters``: int64 (n,), the board's sample numbers; a step other than 1 is a gap.
    ``samples``: uint16 (n, 9). ``flags``: uint8 (n,), bits of the finger wire.
    ``spikes``: uint8 (n, 9), spikes of each taxel in each sample.
    """

    counters: NDArray[np.int64]
    samples: NDArray[np.uint16]
    flags: NDArray[np.uint8]
    spikes: NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class TrackWindow(RingWindow):
    """Newest positions of the finger on the plate, mm, float64 (n,); ``valid``: bool (n,)."""

    along_mm: NDArray[np.float64]
    across_mm: NDArray[np.float64]
    height_mm: NDArray[np.float64]
    valid: NDArray[np.bool_]


class FingerLiveWriter(LiveFileWriter):
    """The engine's side: creates the file and appends rows."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, finger_live(), TAXEL_ROWS, TRACK_ROWS)

    def add_block(self, block: FingerBlock, arrived_s: float) -> None:
        """Append samples; the last one was taken when the block arrived."""
        counters = block.counters
        if not len(counters):
            return
        self._file.taxels.append(
            len(counters),
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

    def add_track(self, time_s: NDArray[np.float64], **columns: NDArray[np.generic]) -> None:
        """Append positions, oldest first, with the columns of :class:`TrackWindow`."""
        self._file.other.append(len(time_s), time_s=time_s, **columns)


class FingerLiveReader(LiveFileReader):
    """A window's side: copies of the newest rows at any time."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, finger_live)

    def taxels(self, n: int) -> FingerWindow:
        """Return the newest ``n`` samples, or all if there are fewer."""
        first, rows = self._file.taxels.newest(n)
        return FingerWindow(first, **rows)

    def track(self, n: int) -> TrackWindow:
        """Return the newest ``n`` positions, or all if there are fewer."""
        first, rows = self._file.other.newest(n)
        return TrackWindow(first, **rows)
