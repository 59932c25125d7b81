"""Reorder the kernel's lanes: by sample, or by trial and time bin.

Trials share a tile side by side; results of a lane behind its trial's end are left out.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray


def to_raster(values: NDArray[Any], n_lanes: int) -> NDArray[Any]:
    """Return (blocks, n, channels, lanes) as (n, channels · n_lanes), contiguous: SA, then RA."""
    blocks, n, channels, block_lanes = values.shape
    by_sample = values.transpose(1, 2, 0, 3).reshape(n, channels, blocks * block_lanes)
    return np.ascontiguousarray(by_sample[:, :, :n_lanes]).reshape(n, channels * n_lanes)


def _accumulate_bins(rows: Any, starts: Any, bins: Any, lengths: Any, sums: Any) -> None:
    """Add rows of spikes, uint8 (blocks, rows, channels, lanes), to their bins in ``sums``.

    ``starts``: int64 (rows,), first sample of each row; ``bins``: its bin; ``lengths``: int64
    (lanes,), samples of each lane's trial. Rows behind them are left out.
    """
    block_lanes = rows.shape[3]
    for block in range(rows.shape[0]):
        ends = lengths[block * block_lanes : (block + 1) * block_lanes]
        shortest = ends.min()
        for r in range(rows.shape[1]):
            for channel in range(rows.shape[2]):
                row, total = rows[block, r, channel], sums[block, bins[r], channel]
                if starts[r] < shortest:
                    for lane in range(block_lanes):
                        total[lane] += np.uint32(row[lane])
                else:
                    for lane in range(block_lanes):
                        if starts[r] < ends[lane]:
                            total[lane] += np.uint32(row[lane])


def _scatter_to_trials(sums: Any, selected: Any, out: Any) -> None:
    """Copy spikes in bins, (blocks, bins, channels, lanes), to the selected trials of ``out``.

    ``out``: (n_trials, trains, bins); SA trains of all encoded taxels, then RA.
    """
    channels, block_lanes = sums.shape[2:]
    n_taxels = out.shape[1] // channels
    for i in range(selected.shape[0]):
        for train in range(out.shape[1]):
            channel, taxel = divmod(train, n_taxels)
            block, lane = divmod(i * n_taxels + taxel, block_lanes)
            counts = out[selected[i], train]
            for b in range(out.shape[2]):
                counts[b] = sums[block, b, channel, lane]


_compile = numba.njit(cache=True, nogil=True, error_model="numpy")
accumulate_bins = _compile(_accumulate_bins)
scatter_to_trials = _compile(_scatter_to_trials)
