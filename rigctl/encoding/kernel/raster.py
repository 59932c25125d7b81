"""What the kernel makes of lanes put in order again: by sample, or by trial and stretch of time.

Trials share a tile side by side, and what a lane shows behind its trial's end is left out.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray


def by_sample(values: NDArray[Any], n_lanes: int) -> NDArray[Any]:
    """(blocks, n, channels, wide) as (n, channels · n_lanes), contiguous: SA lanes, then RA."""
    blocks, n, channels, wide = values.shape
    lanes = values.transpose(1, 2, 0, 3).reshape(n, channels, blocks * wide)[:, :, :n_lanes]
    return np.ascontiguousarray(lanes).reshape(n, channels * n_lanes)


def _add_up(rows: Any, starts: Any, stretches: Any, in_lane: Any, sums: Any) -> None:
    """Add rows of spikes, uint8 (blocks, rows, channels, wide), to their stretches in ``sums``.

    ``starts``: int64 (rows,), first sample of each row; ``stretches``: where it belongs. What a
    lane shows behind its trial's end, int64 (lanes,), is left out.
    """
    wide = rows.shape[3]
    for block in range(rows.shape[0]):
        own = in_lane[block * wide : (block + 1) * wide]
        shortest = own.min()
        for r in range(rows.shape[1]):
            for channel in range(rows.shape[2]):
                row, into = rows[block, r, channel], sums[block, stretches[r], channel]
                if starts[r] < shortest:
                    for lane in range(wide):
                        into[lane] += np.uint32(row[lane])
                else:
                    for lane in range(wide):
                        if starts[r] < own[lane]:
                            into[lane] += np.uint32(row[lane])


def _take_apart(sums: Any, chosen: Any, out: Any) -> None:
    """Spikes between cuts, lane by lane (blocks, stretches, channels, wide), to some trials.

    ``out``: (n_trials, trains, stretches); SA trains of all lanes' taxels, then RA.
    """
    channels, wide = sums.shape[2:]
    some = out.shape[1] // channels
    for place in range(chosen.shape[0]):
        for train in range(out.shape[1]):
            channel, taxel = divmod(train, some)
            block, lane = divmod(place * some + taxel, wide)
            into = out[chosen[place], train]
            for s in range(out.shape[2]):
                into[s] = sums[block, s, channel, lane]


_compile = numba.njit(cache=True, nogil=True, error_model="numpy")
add_up = _compile(_add_up)
take_apart = _compile(_take_apart)
