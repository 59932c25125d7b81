"""Live data of the drum rig in memory that processes share: the engine writes, windows read.

The file holds the last half minute of taxel samples with their spikes and the last minutes of
load-cell samples, each in a ring of rows (:mod:`rigctl.acquisition.live_file`).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rigctl.acquisition.live_file import (
    LiveFileReader,
    LiveFileWriter,
    LiveLayout,
    RingWindow,
)
from rigctl.values import N_TAXELS

MAGIC = 0x3145_5649_4C47_4952  # "RIGLIVE1", low byte first
TAXEL_ROWS = 1 << 15
DRUM_ROWS = 1 << 13

DRUM_LIVE = LiveLayout(
    MAGIC,
    N_TAXELS,
    taxel_columns={
        "time_s": np.dtype(np.float64),
        "counters": np.dtype(np.int64),
        "samples": np.dtype((np.uint16, N_TAXELS)),
        "flags": np.dtype(np.uint8),
        "spikes": np.dtype((np.uint8, 2 * N_TAXELS)),
    },
    other_columns={
        **dict.fromkeys(
            ("time_s", "force_g", "force_set_g", "speed_mm_s", "speed_set_mm_s"),
            np.dtype(np.float64),
        ),
        "state": np.dtype(np.uint8),
    },
)


@dataclass(frozen=True, slots=True)
class TaxelWindow(RingWindow):
    """Newest taxel samples; their times are smoothed over arrival jitter.

    ``counters``: int64 (n,), the board's sample numbers; a step other than 1 is a gap.
    ``samples``: uint16 (n, n_taxels). ``flags``: uint8 (n,), bits of the taxel wire.
    ``spikes``: uint8 (n, 2·n_taxels), spikes in each sample: SA taxel 1…n, then RA 1…n.
    """

    counters: NDArray[np.int64]
    samples: NDArray[np.uint16]
    flags: NDArray[np.uint8]
    spikes: NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class DrumWindow(RingWindow):
    """Newest load-cell samples with the drum's set-points.

    All (n,): ``force_g``, ``force_set_g``, ``speed_mm_s``, ``speed_set_mm_s`` float64, ``state``
    uint8 (value of ``State``).
    """

    force_g: NDArray[np.float64]
    force_set_g: NDArray[np.float64]
    speed_mm_s: NDArray[np.float64]
    speed_set_mm_s: NDArray[np.float64]
    state: NDArray[np.uint8]


class LiveWriter(LiveFileWriter):
    """The engine's side: creates the file and appends rows."""

    def __init__(
        self, path: Path, taxel_rows: int = TAXEL_ROWS, drum_rows: int = DRUM_ROWS
    ) -> None:
        super().__init__(path, DRUM_LIVE, taxel_rows, drum_rows)

    def add_taxels(self, **columns: NDArray[np.generic]) -> None:
        """Append samples, oldest first, with the columns of :class:`TaxelWindow`."""
        self._file.taxels.append(len(columns["time_s"]), **columns)

    def add_drum(self, time_s: NDArray[np.float64], **columns: NDArray[np.float64] | float) -> None:
        """Append the load-cell samples of one poll, with the columns of :class:`DrumWindow`."""
        self._file.other.append(len(time_s), time_s=time_s, **columns)


class LiveReader(LiveFileReader):
    """A window's side: copies of the newest rows at any time."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, DRUM_LIVE)

    def taxels(self, n: int) -> TaxelWindow:
        """Return the newest ``n`` samples, or all if there are fewer."""
        first, rows = self._file.taxels.newest(n)
        return TaxelWindow(first, **rows)

    def drum(self, n: int) -> DrumWindow:
        """Return the newest ``n`` load-cell samples, or all if there are fewer."""
        first, rows = self._file.other.newest(n)
        return DrumWindow(first, **rows)
