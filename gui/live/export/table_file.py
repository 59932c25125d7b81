"""The table of what the views show. This module does not import Qt."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.files import atomic_file

Floats = NDArray[np.float64]
_ROWS_AT_ONCE = 20_000
COUNTS = "counts (0–1023)"


class ShownSamples(NamedTuple):
    """Samples in a time window with force and speed at each of them.

    ``time_s``: engine's time, float64 (n,). ``position``: board's counter, int64 (n,).
    ``samples``: readings in ``unit``, uint16 (n, k); ``taxels``: their numbers from 0.
    ``spikes``: uint8 (n, 2·k), SA then RA. ``drum``: (n,) each, NaN before the first reading of
    the load cell.
    """

    title: str
    time_s: Floats
    position: NDArray[np.int64]
    samples: NDArray[np.uint16]
    spikes: NDArray[np.uint8]
    taxels: tuple[int, ...]
    drum: dict[str, Floats]
    unit: str = COUNTS


def write_table(shown: ShownSamples, path: Path) -> None:
    """Write one line a sample, behind a comment on the units. Raises DiskFault, never replaces."""
    names = [f"T{taxel + 1}" for taxel in shown.taxels]
    trains = [f"T_{channel}-{taxel + 1}" for channel in ("SA", "RA") for taxel in shown.taxels]
    header = ["sample", "time_s", *shown.drum, *names, *trains]
    formats = ["%d", "%.6f"] + ["%.2f"] * len(shown.drum) + ["%d"] * (len(names) + len(trains))
    with atomic_file(path) as partial, partial.open("w", encoding="utf-8") as file:
        file.write(f"# {shown.title}; T… readings in {shown.unit}, T_… spikes in the sample\n")
        file.write(",".join(header) + "\n")
        for first in range(0, len(shown.time_s), _ROWS_AT_ONCE):
            rows = slice(first, first + _ROWS_AT_ONCE)
            drum = [column[rows] for column in shown.drum.values()]
            columns = [shown.position[rows], shown.time_s[rows], *drum]
            table = np.column_stack((*columns, shown.samples[rows], shown.spikes[rows]))
            np.savetxt(file, table, fmt=",".join(formats))
