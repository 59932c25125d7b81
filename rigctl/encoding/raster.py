"""Readings laid side by side in lanes, and the spikes of the lanes put in order again.

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
from rigctl.values import Spikes

WORD = 2 * LANES
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


class Trains:
    """Spike trains of trials side by side, gathered stretch by stretch.

    ``memory``: of trains gathered before, to be used again as with a tile.
    """

    def __init__(
        self, trials: Sequence[NDArray[np.uint16]], memory: NDArray[np.int32] | None = None
    ) -> None:
        self._n_taxels = trials[0].shape[1]
        self._lengths = [len(samples) for samples in trials]
        lanes = len(trials) * self._n_taxels
        self._in_lane = np.zeros(filled_up(lanes, LANES), np.int64)
        self._in_lane[:lanes] = np.repeat(self._lengths, self._n_taxels)
        self._n_spikes = np.zeros(2 * len(self._in_lane), np.int64)
        self.memory = np.empty(0, np.int32) if memory is None else memory
        self._room = self.memory.size // len(self._n_spikes)

    def add(self, counts: NDArray[np.uint8], start: int) -> None:
        """Take in the counts of each sample, uint8 (blocks, n, 2, 32), from sample ``start``."""
        stop, most = start + counts.shape[1], int(counts.max(initial=0))
        self._make_room(int(self._n_spikes.max()) + most * counts.shape[1])
        # Nearly always there is nothing to ask of a spike but when it was.
        plain = most <= 1 and stop <= min(self._lengths)
        _take_compiled(counts, start, self._in_lane, plain, self._samples(), self._n_spikes)

    def spikes(self) -> list[Spikes]:
        """The trains of each trial."""
        return [self._of_trial(place, n) for place, n in enumerate(self._lengths)]

    def _samples(self) -> NDArray[np.int32]:
        """Samples of the spikes of each train, int32 (trains, room)."""
        trains = len(self._n_spikes)
        return self.memory[: trains * self._room].reshape(trains, self._room)

    def _make_room(self, spikes: int) -> None:
        if self._room >= spikes:
            return
        before, used = self._samples(), int(self._n_spikes.max())
        self._room = max(2 * spikes, max(self._lengths) // 3)
        self.memory = np.empty(len(self._n_spikes) * self._room, np.int32)
        self._samples()[:, :used] = before[:, :used]

    def _of_trial(self, place: int, n_samples: int) -> Spikes:
        lanes = np.arange(place * self._n_taxels, (place + 1) * self._n_taxels)
        sa = lanes // LANES * WORD + lanes % LANES
        trains = np.concatenate([sa, sa + LANES])
        starts = np.zeros(len(trains) + 1, np.int64)
        np.cumsum(self._n_spikes[trains], out=starts[1:])
        samples = np.empty(starts[-1], np.int32)
        _gather_compiled(self._samples(), trains, starts, samples)
        return Spikes(starts, samples, n_samples)


@emitted
def spiking(_typing: Any, tallies: Any, index: Any) -> Any:
    """Which of 64 tallies, from a flat index on, are not 0: one bit each."""
    vector = ir.VectorType(ir.IntType(8), 64)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        place = pointer(context, builder, signature.args[0], arguments[0], arguments[1], vector)
        some = builder.icmp_unsigned("!=", builder.load(place, align=1), vector([0] * 64))
        return builder.bitcast(some, ir.IntType(64))

    return types.uint64(tallies, types.intp), generate


@emitted
def lowest(_typing: Any, bits: Any) -> Any:
    """Place of the lowest bit that is set."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.cttz(arguments[0], ir.Constant(ir.IntType(1), 1))

    return types.intp(types.uint64), generate


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


def _take(counts: Any, start: Any, in_lane: Any, plain: Any, samples: Any, n_spikes: Any) -> None:
    """Write the sample of each spike behind those that its train, a row of ``samples``, has.

    ``n_spikes``: int64 (trains,), of each train so far; 32 trains of SA and 32 of RA for a block.
    ``plain``: no sample holds two spikes, and no trial is over. Only lanes with spikes are visited.
    """
    blocks, n = counts.shape[:2]
    flat = counts.reshape(-1)
    for block in range(blocks):
        for t in range(n):
            at = (block * n + t) * WORD
            bits = spiking(counts, at)
            while bits != 0:
                place = lowest(bits)
                bits &= bits - np.uint64(1)
                train = block * WORD + place
                if plain:
                    samples[train, n_spikes[train]] = start + t
                    n_spikes[train] += 1
                elif start + t < in_lane[block * LANES + place % LANES]:
                    for _ in range(flat[at + place]):
                        samples[train, n_spikes[train]] = start + t
                        n_spikes[train] += 1


def _gather(samples: Any, trains: Any, starts: Any, out: Any) -> None:
    """Some trains one behind the other."""
    for i in range(trains.shape[0]):
        row = samples[trains[i]]
        for spike in range(starts[i + 1] - starts[i]):
            out[starts[i] + spike] = row[spike]


_compile = numba.njit(cache=True, nogil=True, error_model="numpy")
_lay_compiled = _compile(_lay)
add_up = _compile(_add_up)
_take_compiled = _compile(_take)
_gather_compiled = _compile(_gather)
