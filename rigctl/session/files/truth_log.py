"""Write the log of one sitting of a simulated world while it happens."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rigctl.errors import DiskFault, SessionError
from rigctl.session.files.truth_file import (
    END,
    LAYOUT,
    LAYOUT_VERSION,
    PARTIAL,
    TRUTH_LAYOUT,
    Start,
    log_name,
)
from rigctl.session.hdf5_file import Attributes, system_reason
from rigctl.session.write.part_writer import PartWriter
from rigctl.values import Gap

TruthRows = tuple[int, NDArray[np.float32], NDArray[np.float32], NDArray[np.uint8]]
"""First millisecond, then speed in mm/s, force in g and sync, one value for each millisecond."""
_WRITE_ERRORS = (OSError, RuntimeError, DiskFault)
"""What a full disk and HDF5 raise, and the part's writer where its file has lost its name."""


@dataclass(frozen=True, slots=True)
class TruthBlock:
    """Milliseconds in a row; ``counters`` are those of the world, int64 (n,)."""

    counters: NDArray[np.int64]
    speed_mm_s: NDArray[np.float32]
    force_g: NDArray[np.float32]
    sync: NDArray[np.uint8]
    gaps: tuple[Gap, ...] = ()
    arrived_s: float = 0.0

    def __len__(self) -> int:
        return len(self.counters)


class TruthLog:
    """The log of one sitting, ``world.h5.partial`` until :meth:`close` gives it its name.

    A killed process leaves the rows of its last :meth:`write`. ``start`` is that of the sitting's
    parts, ``first_ms`` the world time of the first row. Every method raises DiskFault where the
    disk does not take it; the log then ends with the last write that was whole.
    """

    def __init__(self, folder: Path, sitting: int, start: Start, first_ms: int) -> None:
        self.path = folder / log_name(sitting)
        self._partial = self.path.with_name(self.path.name + PARTIAL)
        self._next_ms = first_ms
        self._part: PartWriter | None = None
        attributes: Attributes = {
            "layout": LAYOUT,
            "layout_version": LAYOUT_VERSION,
            "first_ms": first_ms,
            "sitting": sitting,
            "start_utc": start[0],
            "start_loop_s": start[1],
        }
        try:
            self._partial.unlink(missing_ok=True)
            self._part = PartWriter(self._partial, TRUTH_LAYOUT, attributes, 0, ("", ""))
            self._part.write()
        except _WRITE_ERRORS as error:
            raise self._fail(error) from error
        self._n_rows = 0

    def write(self, rows: TruthRows) -> None:
        """Append rows, which must follow those before, and flush them."""
        first_ms, speed, force, sync = rows
        if first_ms != self._next_ms:
            raise SessionError(
                f"{self._partial} ends at {self._next_ms} ms and the new rows begin at {first_ms} "
                "ms: part of the truth is missing"
            )
        self._next_ms += len(sync)
        self._n_rows += len(sync)
        counters = np.arange(first_ms, self._next_ms, dtype=np.int64)
        if self._part is None or not len(sync):
            return
        try:
            self._part.add_samples(TruthBlock(counters, speed, force, sync))
            self._part.write()
        except _WRITE_ERRORS as error:
            raise self._fail(error) from error

    def close(self) -> Path:
        """Close the log, give it its name in place of an older one, and return its path."""
        if self._part is None:
            return self._partial
        try:
            self._part.add_rows(END, [(self._n_rows,)])
            self._part.write()
            self._part.sync()
            self._part.close()
            self._part = None
            self._partial.replace(self.path)
        except _WRITE_ERRORS as error:
            raise self._fail(error) from error
        return self.path

    def _fail(self, error: OSError | RuntimeError | DiskFault) -> DiskFault:
        part, self._part = self._part, None
        if part is not None:
            part.abandon()
        reason = error if isinstance(error, DiskFault) else system_reason(error)
        return DiskFault(
            f"{self._partial} could not be written ({reason}): the truth of the simulated world "
            "ends there; make room on the disk"
        )
