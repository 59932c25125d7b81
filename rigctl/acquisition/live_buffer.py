"""Live data in memory that processes share: the engine writes it, windows read it.

The file holds the last half minute of taxel samples with their spikes and the last minutes of
load-cell samples. A reader never blocks the writer, and never sees a half-written row.
"""

from __future__ import annotations

import mmap
import os
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.acquisition.ring_buffer import RingBuffer, RingColumn, ring_bytes
from rigctl.errors import RigFault
from rigctl.values import N_TAXELS

MAGIC = 0x3145_5649_4C47_4952  # "RIGLIVE1", low byte first
TAXEL_ROWS = 1 << 15
DRUM_ROWS = 1 << 13
_HEADER_BYTES = 1024
_HEADER_WORDS = 8  # magic, taxels, taxel rows, drum rows, version of the range, three spare
_RANGE_OFFSET = 64
_RANGE_TRIES = 1000
_NEW_FILE = os.O_RDWR | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)


class RowCounts(NamedTuple):
    """Rows written since the engine started; an unchanged count means no new data."""

    taxels: int
    drum: int


class LiveRange(NamedTuple):
    """Readings that the encoder maps to 0 and 1, uint16 (n_taxels,) each."""

    low: NDArray[np.uint16]
    high: NDArray[np.uint16]


@dataclass(frozen=True, slots=True)
class TaxelWindow:
    """Newest taxel samples, oldest first, copied out of the ring.

    ``first``: row number of the first sample in the stream of all rows written.
    ``time_s``: float64 (n,), loop time of each sample, smoothed over arrival jitter.
    ``counters``: int64 (n,), the board's sample numbers; a step other than 1 is a gap.
    ``samples``: uint16 (n, n_taxels). ``flags``: uint8 (n,), bits of the taxel wire.
    ``spikes``: uint8 (n, 2·n_taxels), spikes in each sample: SA taxel 1…n, then RA 1…n.
    """

    first: int
    time_s: NDArray[np.float64]
    counters: NDArray[np.int64]
    samples: NDArray[np.uint16]
    flags: NDArray[np.uint8]
    spikes: NDArray[np.uint8]

    def __len__(self) -> int:
        return int(self.time_s.shape[0])


@dataclass(frozen=True, slots=True)
class DrumWindow:
    """Newest load-cell samples with the drum's set-points, oldest first.

    All (n,): ``time_s`` loop time, ``force_g``, ``force_set_g``, ``speed_mm_s``,
    ``speed_set_mm_s`` float64, ``state`` uint8 (value of ``State``). ``first`` as above.
    """

    first: int
    time_s: NDArray[np.float64]
    force_g: NDArray[np.float64]
    force_set_g: NDArray[np.float64]
    speed_mm_s: NDArray[np.float64]
    speed_set_mm_s: NDArray[np.float64]
    state: NDArray[np.uint8]

    def __len__(self) -> int:
        return int(self.time_s.shape[0])


def _taxel_columns(n_taxels: int) -> tuple[RingColumn, ...]:
    return (
        RingColumn("time_s", np.float64),
        RingColumn("counters", np.int64),
        RingColumn("samples", np.uint16, n_taxels),
        RingColumn("flags", np.uint8),
        RingColumn("spikes", np.uint8, 2 * n_taxels),
    )


_DRUM_COLUMNS = (
    *(
        RingColumn(name, np.float64)
        for name in ("time_s", "force_g", "force_set_g", "speed_mm_s", "speed_set_mm_s")
    ),
    RingColumn("state", np.uint8),
)


class _LiveFile:
    """Views of the file's parts, for the writer and for readers."""

    def __init__(self, memory: mmap.mmap, n_taxels: int, taxel_rows: int, drum_rows: int) -> None:
        self.memory = memory
        self.header = np.frombuffer(memory, dtype=np.int64, count=_HEADER_WORDS)
        self.range = np.frombuffer(
            memory, dtype=np.uint16, count=2 * n_taxels, offset=_RANGE_OFFSET
        ).reshape(2, n_taxels)
        self.taxels = RingBuffer(memory, _HEADER_BYTES, taxel_rows, _taxel_columns(n_taxels))
        drum_offset = _HEADER_BYTES + ring_bytes(taxel_rows, _taxel_columns(n_taxels))
        self.drum = RingBuffer(memory, drum_offset, drum_rows, _DRUM_COLUMNS)

    def close(self) -> None:
        self.taxels.release()
        self.drum.release()
        self.header = np.zeros(_HEADER_WORDS, dtype=np.int64)
        self.range = np.zeros((2, 1), dtype=np.uint16)
        self.memory.close()


class LiveWriter:
    """The engine's side: creates the file and appends rows."""

    def __init__(
        self,
        path: Path,
        n_taxels: int = N_TAXELS,
        taxel_rows: int = TAXEL_ROWS,
        drum_rows: int = DRUM_ROWS,
    ) -> None:
        self.path = path
        size = _HEADER_BYTES + ring_bytes(taxel_rows, _taxel_columns(n_taxels))
        size += ring_bytes(drum_rows, _DRUM_COLUMNS)
        descriptor = os.open(path, _NEW_FILE, 0o600)
        try:
            os.ftruncate(descriptor, size)
            memory = mmap.mmap(descriptor, size)
        finally:
            os.close(descriptor)
        self._file = _LiveFile(memory, n_taxels, taxel_rows, drum_rows)
        self._file.header[1:5] = (n_taxels, taxel_rows, drum_rows, 0)
        self._file.header[0] = MAGIC

    def set_range(self, low: NDArray[np.uint16], high: NDArray[np.uint16]) -> None:
        """Store the readings that the encoder maps to 0 and 1; the version is odd meanwhile."""
        self._file.header[4] += 1
        self._file.range[0] = low
        self._file.range[1] = high
        self._file.header[4] += 1

    def add_taxels(
        self,
        time_s: NDArray[np.float64],
        counters: NDArray[np.int64],
        samples: NDArray[np.uint16],
        flags: NDArray[np.uint8],
        spikes: NDArray[np.uint8],
    ) -> None:
        """Append samples, oldest first, shapes as in :class:`TaxelWindow`."""
        self._file.taxels.append(
            len(counters),
            time_s=time_s,
            counters=counters,
            samples=samples,
            flags=flags,
            spikes=spikes,
        )

    def add_drum(
        self,
        time_s: NDArray[np.float64],
        force_g: NDArray[np.float64],
        force_set_g: float,
        speed_mm_s: float,
        speed_set_mm_s: float,
        state: int,
    ) -> None:
        """Append the load-cell samples of one poll, oldest first, with that poll's state."""
        self._file.drum.append(
            len(time_s),
            time_s=time_s,
            force_g=force_g,
            force_set_g=force_set_g,
            speed_mm_s=speed_mm_s,
            speed_set_mm_s=speed_set_mm_s,
            state=state,
        )

    def close(self) -> None:
        """Remove the file; readers that have it open keep their data."""
        self._file.close()
        self.path.unlink(missing_ok=True)


class LiveView:
    """A window's side: copies of the newest rows at any time."""

    def __init__(self, path: Path) -> None:
        self.path = Path(path)
        n_taxels, taxel_rows, drum_rows = _read_header(self.path)
        with self.path.open("rb") as file:
            memory = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        self.n_taxels = n_taxels
        self._file = _LiveFile(memory, n_taxels, taxel_rows, drum_rows)

    @property
    def heads(self) -> RowCounts:
        """Rows written so far."""
        return RowCounts(self._file.taxels.head, self._file.drum.head)

    @property
    def normalisation(self) -> LiveRange:
        """Lowest and highest reading of each taxel, as the live encoder uses them."""
        low, high = self._file.range.copy()
        for _ in range(_RANGE_TRIES):  # a killed engine may leave the version odd
            version = int(self._file.header[4])
            low, high = self._file.range.copy()
            if version % 2 == 0 and int(self._file.header[4]) == version:
                break
        return LiveRange(low, high)

    def taxels(self, n: int) -> TaxelWindow:
        """Return the newest ``n`` samples, or all if there are fewer."""
        first, rows = self._file.taxels.newest(n)
        return TaxelWindow(first, **rows)

    def drum(self, n: int) -> DrumWindow:
        """Return the newest ``n`` load-cell samples, or all if there are fewer."""
        first, rows = self._file.drum.newest(n)
        return DrumWindow(first, **rows)

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def _read_header(path: Path) -> tuple[int, int, int]:
    """Return taxels, taxel rows and drum rows. Raises RigFault where it is no live-data file."""
    try:
        with path.open("rb") as file:
            words = np.frombuffer(file.read(8 * _HEADER_WORDS), dtype=np.int64)
    except OSError as error:
        raise RigFault(
            f"live data {path} cannot be opened ({error.strerror}): check that the engine runs"
        ) from error
    if words.shape[0] < _HEADER_WORDS or words[0] != MAGIC:
        raise RigFault(f"{path} holds no live data of this version: restart the engine")
    return int(words[1]), int(words[2]), int(words[3])
