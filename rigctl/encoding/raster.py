"""Readings laid side by side in lanes, and what the kernel makes of lanes put in order again.

Trials share a tile side by side; one that is shorter holds its last reading to the tile's end, and
the spikes of what follows are left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba.core import types
from numpy.typing import NDArray

from rigctl.encoding.blocks import filled_up
from rigctl.encoding.compiled import LANES, emitted, pointer

BYTES = 2
# Readings that are copied at a time.
RUN = 16


class Tile:
    """Trials side by side, a lane for each trial and taxel (some ``taxels`` only, or all).

    ``wide``: lanes of a block. ``memory``: of a tile that is done with, to be used again: fresh
    memory costs as much as the work done in it.
    """

    def __init__(
        self,
        trials: Sequence[NDArray[np.uint16]],
        taxels: NDArray[np.int64] | None = None,
        wide: int = LANES,
        memory: NDArray[np.uint16] | None = None,
    ) -> None:
        n_taxels = trials[0].shape[1]
        self._taxels = np.arange(n_taxels) if taxels is None else taxels
        self._gapless = bool((np.diff(self._taxels) == 1).all())
        self._row_bytes = n_taxels * np.dtype(np.uint16).itemsize
        # The kernel is handed their addresses: they must stay.
        self._trials = [np.ascontiguousarray(samples, np.uint16) for samples in trials]
        self._addresses = np.array([t.__array_interface__["data"][0] for t in self._trials])
        self._lengths = np.array([len(samples) for samples in trials])
        self._lanes = filled_up(len(trials) * len(self._taxels), wide)
        self.memory = np.empty(0, np.uint16) if memory is None else memory

    def laid(self, start: int, stop: int) -> NDArray[np.uint16]:
        """Samples ``start`` to ``stop`` of all, uint16 (stop − start, lanes), trial after trial.

        Lanes behind the last one hold anything. Overwritten when the next stretch is asked for.
        """
        size = (stop - start) * self._lanes
        if self.memory.size < size:
            self.memory = np.empty(size, np.uint16)
        tile = self.memory[:size].reshape(stop - start, self._lanes)
        source = (self._addresses, self._lengths, self._row_bytes, self._taxels, self._gapless)
        _lay_compiled(*source, start, tile)
        return tile

    def by_lane(self, of_trials: NDArray[np.int64]) -> NDArray[np.int64]:
        """A number of each trial for each lane, int64 (lanes,); 0 behind the last one."""
        lanes = np.zeros(self._lanes, np.int64)
        lanes[: len(of_trials) * len(self._taxels)] = np.repeat(of_trials, len(self._taxels))
        return lanes


def by_sample(values: NDArray[Any], n_lanes: int) -> NDArray[Any]:
    """(blocks, n, channels, wide) as (n, channels · n_lanes), contiguous: SA lanes, then RA."""
    blocks, n, channels, wide = values.shape
    lanes = values.transpose(1, 2, 0, 3).reshape(n, channels, blocks * wide)[:, :, :n_lanes]
    return np.ascontiguousarray(lanes).reshape(n, channels * n_lanes)


@emitted
def reading(_typing: Any, address: Any) -> Any:
    """The reading at an address in memory."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.load(builder.inttoptr(arguments[0], ir.IntType(16).as_pointer()), align=2)

    return types.uint16(types.intp), generate


@emitted
def copy_run(_typing: Any, target: Any, index: Any, address: Any) -> Any:
    """Copy :data:`RUN` readings from an address in memory to a flat index of an array."""
    vector = ir.VectorType(ir.IntType(16), RUN)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        place = pointer(context, builder, signature.args[0], arguments[0], arguments[1], vector)
        source = builder.inttoptr(arguments[2], vector.as_pointer())
        builder.store(builder.load(source, align=2), place, align=2)
        return context.get_dummy_value()

    return types.void(target, types.intp, types.intp), generate


def _lay(
    addresses: Any, lengths: Any, row_bytes: Any, taxels: Any, gapless: Any, start: Any, tile: Any
) -> None:
    """Copy some taxels of each trial into the tile's lanes; its last row fills the rest."""
    lanes, some = tile.shape[1], taxels.shape[0]
    flat = tile.reshape(-1)
    runs = gapless and some >= RUN
    for trial in range(addresses.shape[0]):
        n = lengths[trial]
        own = max(0, min(tile.shape[0], n - start))
        at, row = trial * some, addresses[trial] + start * row_bytes + BYTES * taxels[0]
        if runs:
            for _ in range(own):
                for j in range(0, some - RUN, RUN):
                    copy_run(flat, at + j, row + BYTES * j)
                # The last run overlaps the one before, so that nothing beyond the row is touched.
                copy_run(flat, at + some - RUN, row + BYTES * (some - RUN))
                at, row = at + lanes, row + row_bytes
        for t in range(own if runs else 0, tile.shape[0]):
            at = t * lanes + trial * some
            row = addresses[trial] + min(start + t, n - 1) * row_bytes
            for j in range(some):
                flat[at + j] = reading(row + BYTES * taxels[j]) if n else 0


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


_compile = numba.njit(cache=True, nogil=True, error_model="numpy")
_lay_compiled = _compile(_lay)
add_up = _compile(_add_up)
