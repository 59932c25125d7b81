"""Readings laid side by side in lanes, and what the kernel makes of lanes put in order again.

Trials share a tile side by side; one that is shorter holds its last reading to the tile's end, and
the spikes of what follows are left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba.core import types
from numpy.typing import NDArray

from rigctl.encoding.blocks import filled_up
from rigctl.encoding.compiled import LANES
from rigctl.encoding.lanes import emitted, pointer

BYTES = 2
# Readings that are copied at a time, and rows of a tile that are filled before the next.
RUN, AT_A_TIME = 16, 256


@dataclass(frozen=True, slots=True)
class Rows:
    """Where the readings of trials lie, row by row of all taxels.

    ``addresses``, ``lengths``: int64 (n_trials,); ``row_bytes``: of one row. ``held``: what must
    stay in memory meanwhile, as the kernels are handed addresses.
    """

    addresses: NDArray[np.int64]
    lengths: NDArray[np.int64]
    row_bytes: int
    held: Sequence[NDArray[np.uint16]]

    def __len__(self) -> int:
        return len(self.lengths)

    @classmethod
    def of(cls, trials: Trials) -> Rows:
        """Of arrays uint16 (n_i, n_taxels), or what can be made such; one that is made stays."""
        if isinstance(trials, Rows):
            return trials
        held = [np.require(samples, np.uint16, ["C", "A"]) for samples in trials]
        at = np.array([samples.__array_interface__["data"][0] for samples in held], np.int64)
        row_bytes = BYTES * held[0].shape[1] if held else 0
        return cls(at, np.array(list(map(len, held)), np.int64), row_bytes, held)

    def some(self, which: Any) -> Rows:
        """Of some trials: a list of indices, or a slice."""
        return replace(self, addresses=self.addresses[which], lengths=self.lengths[which])


Trials = Sequence[NDArray[np.uint16]] | Rows


class Tile:
    """Trials side by side, a lane for each trial and taxel.

    ``lanes``: with those that fill its blocks up. ``memory``: of a tile that is done with, to be
    used again: fresh memory costs as much as the work done in it.
    """

    def __init__(
        self,
        rows: Rows,
        taxels: NDArray[np.int64],
        lanes: int,
        memory: NDArray[np.uint16] | None = None,
    ) -> None:
        self._rows, self._taxels, self._lanes = rows, taxels, lanes
        self.memory = np.empty(0, np.uint16) if memory is None else memory

    @classmethod
    def of_trials(
        cls, trials: Sequence[NDArray[np.uint16]], memory: NDArray[np.uint16] | None = None
    ) -> Tile:
        """All taxels of trials, in blocks of both channels."""
        n_taxels = trials[0].shape[1]
        lanes = filled_up(len(trials) * n_taxels, LANES)
        return cls(Rows.of(trials), np.arange(n_taxels), lanes, memory)

    def laid(self, start: int, stop: int) -> NDArray[np.uint16]:
        """Samples ``start`` to ``stop`` of all, uint16 (stop − start, lanes), trial after trial.

        Lanes behind the last one hold anything. Overwritten when the next stretch is asked for.
        """
        size = (stop - start) * self._lanes
        if self.memory.size < size:
            self.memory = np.empty(size, np.uint16)
        tile = self.memory[:size].reshape(stop - start, self._lanes)
        rows = self._rows
        _lay_compiled(rows.addresses, rows.row_bytes, rows.lengths, self._taxels, start, tile)
        return tile


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


def _lay(addresses: Any, row_bytes: Any, lengths: Any, taxels: Any, start: Any, tile: Any) -> None:
    """Copy some taxels of each trial into the tile's lanes; its last row fills the rest."""
    lanes, some = tile.shape[1], taxels.shape[0]
    flat = tile.reshape(-1)
    runs = some >= RUN
    for j in range(1, some):
        runs = runs and taxels[j] == taxels[j - 1] + 1
    for first in range(0, tile.shape[0], AT_A_TIME):
        stop = min(tile.shape[0], first + AT_A_TIME)
        for trial in range(addresses.shape[0]):
            n = lengths[trial]
            own = max(first, min(stop, n - start))
            lane = trial * some
            if runs:
                at = first * lanes + lane
                row = addresses[trial] + (start + first) * row_bytes + BYTES * taxels[0]
                for _ in range(first, own):
                    for j in range(0, some - RUN, RUN):
                        copy_run(flat, at + j, row + BYTES * j)
                    # The last run overlaps the one before: nothing beyond the row is touched.
                    copy_run(flat, at + some - RUN, row + BYTES * (some - RUN))
                    at, row = at + lanes, row + row_bytes
            for t in range(own if runs else first, stop):
                at = t * lanes + lane
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
_lay_compiled = _compile(_lay)
add_up = _compile(_add_up)
take_apart = _compile(_take_apart)
