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
LANE_BITS = 32


class Tile:
    """Trials side by side, a lane for each trial and taxel (some ``taxels`` only, or all)."""

    def __init__(
        self, trials: Sequence[NDArray[np.uint16]], taxels: NDArray[np.int64] | None = None
    ) -> None:
        n_taxels = trials[0].shape[1]
        self._taxels = np.arange(n_taxels) if taxels is None else taxels
        self._gapless = bool((np.diff(self._taxels) == 1).all())
        self._row_bytes = n_taxels * np.dtype(np.uint16).itemsize
        # The kernel is handed their addresses: they must stay.
        self._trials = [np.ascontiguousarray(samples, np.uint16) for samples in trials]
        self._addresses = np.array([t.__array_interface__["data"][0] for t in self._trials])
        self._lengths = np.array([len(samples) for samples in trials])
        self._lanes = filled_up(len(trials) * len(self._taxels))
        self._memory = np.empty((0, self._lanes), np.uint16)

    def laid(self, start: int, stop: int) -> NDArray[np.uint16]:
        """Samples ``start`` to ``stop`` of all, uint16 (stop − start, lanes), trial after trial.

        Lanes behind the last one hold anything. Overwritten when the next stretch is asked for.
        """
        if len(self._memory) < stop - start:
            self._memory = np.zeros((stop - start, self._lanes), np.uint16)
        tile = self._memory[: stop - start]
        source = (self._addresses, self._lengths, self._row_bytes, self._taxels, self._gapless)
        _lay_compiled(*source, start, tile)
        return tile

    def by_lane(self, of_trials: NDArray[np.int64]) -> NDArray[np.int64]:
        """A number of each trial for each lane, int64 (lanes,); 0 behind the last one."""
        lanes = np.zeros(self._lanes, np.int64)
        lanes[: len(of_trials) * len(self._taxels)] = np.repeat(of_trials, len(self._taxels))
        return lanes


def by_sample(values: NDArray[Any], n_lanes: int) -> NDArray[Any]:
    """(blocks, n, channels, 32) as (n, channels · n_lanes), contiguous: SA lanes, then RA."""
    blocks, n, channels, wide = values.shape
    lanes = values.transpose(1, 2, 0, 3).reshape(n, channels, blocks * wide)[:, :, :n_lanes]
    return np.ascontiguousarray(lanes).reshape(n, channels * n_lanes)


class Trains:
    """Spike trains of trials side by side, gathered stretch by stretch."""

    def __init__(self, trials: Sequence[NDArray[np.uint16]]) -> None:
        self._n_taxels = trials[0].shape[1]
        self._lengths = [len(samples) for samples in trials]
        lanes = len(trials) * self._n_taxels
        self._half = filled_up(lanes)
        self._in_lane = np.zeros(self._half, np.int64)
        self._in_lane[:lanes] = np.repeat(self._lengths, self._n_taxels)
        self._n_spikes = np.zeros(2 * self._half, np.int64)
        self._room = np.empty(0, np.int64)
        self._found: list[NDArray[np.int64]] = []

    def add(self, counts: NDArray[np.uint8], start: int) -> None:
        """Take in the counts of each sample, uint8 (blocks, n, 2, 32), from sample ``start``."""
        # Asking for the sum costs more than finding the spikes, and one a sample is the most.
        most = counts.size if counts.max(initial=0) <= 1 else int(counts.sum(dtype=np.int64))
        if len(self._room) < most:
            self._room = np.empty(most, np.int64)
        n = _find_compiled(counts, start, self._in_lane, self._room, self._n_spikes)
        self._found.append(self._room[:n].copy())

    def spikes(self) -> list[Spikes]:
        """The trains of each trial."""
        row_start = np.zeros(len(self._n_spikes) + 1, np.int64)
        np.cumsum(self._n_spikes, out=row_start[1:])
        sample_index = np.empty(row_start[-1], np.int32)
        free = row_start[:-1].copy()
        for found in self._found:
            _distribute_compiled(found, free, sample_index)
        return [self._of_trial(i, row_start, sample_index) for i in range(len(self._lengths))]

    def _of_trial(
        self, place: int, row_start: NDArray[np.int64], sample_index: NDArray[np.int32]
    ) -> Spikes:
        first, n = place * self._n_taxels, self._n_taxels
        ends = [row_start[at : at + n + 1] for at in (first, self._half + first)]
        indices = np.concatenate([sample_index[end[0] : end[-1]] for end in ends])
        sa, ra = (end - end[0] for end in ends)
        starts = np.concatenate([sa, sa[-1] + ra[1:]])
        return Spikes(starts, indices, self._lengths[place])


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
    for trial in range(addresses.shape[0]):
        n = lengths[trial]
        for t in range(tile.shape[0]):
            at = t * lanes + trial * some
            row = addresses[trial] + min(start + t, n - 1) * row_bytes
            if n == 0:
                for j in range(some):
                    flat[at + j] = 0
            elif gapless and some >= RUN:
                row += BYTES * taxels[0]
                for j in range(0, some - RUN, RUN):
                    copy_run(flat, at + j, row + BYTES * j)
                # The last run overlaps the one before, so that nothing beyond the row is touched.
                copy_run(flat, at + some - RUN, row + BYTES * (some - RUN))
            else:
                for j in range(some):
                    flat[at + j] = reading(row + BYTES * taxels[j])


def _add_up(rows: Any, starts: Any, stretches: Any, in_lane: Any, sums: Any) -> None:
    """Add rows of spikes, uint8 (blocks, rows, channels, 32), to their stretches in ``sums``.

    ``starts``: int64 (rows,), first sample of each row; ``stretches``: where it belongs. What a
    lane shows behind its trial's end, int64 (lanes,), is left out.
    """
    for block in range(rows.shape[0]):
        own = in_lane[block * LANES : (block + 1) * LANES]
        shortest = own.min()
        for r in range(rows.shape[1]):
            for channel in range(rows.shape[2]):
                row, into = rows[block, r, channel], sums[block, stretches[r], channel]
                if starts[r] < shortest:
                    for lane in range(LANES):
                        into[lane] += np.uint32(row[lane])
                else:
                    for lane in range(LANES):
                        if starts[r] < own[lane]:
                            into[lane] += np.uint32(row[lane])


def _find(counts: Any, start: Any, in_lane: Any, found: Any, n_spikes: Any) -> Any:
    """List every spike as sample · 2³² + train; return how many there are.

    ``n_spikes`` int64 (trains,) is added to: SA of all lanes, then RA. Only lanes with spikes are
    visited.
    """
    blocks, n = counts.shape[:2]
    flat = counts.reshape(-1)
    entries = 0
    for block in range(blocks):
        for t in range(n):
            at = (block * n + t) * WORD
            bits = spiking(counts, at)
            while bits != 0:
                place = lowest(bits)
                bits &= bits - np.uint64(1)
                lane = block * LANES + place % LANES
                if start + t < in_lane[lane]:
                    train = lane + place // LANES * blocks * LANES
                    n_spikes[train] += flat[at + place]
                    for _ in range(flat[at + place]):
                        found[entries] = (start + t) << LANE_BITS | train
                        entries += 1
    return entries


def _distribute(found: Any, free: Any, sample_index: Any) -> None:
    """Write every spike's sample; ``free`` int64 (trains,) holds each train's next free place."""
    for i in range(found.shape[0]):
        train = found[i] & ((1 << LANE_BITS) - 1)
        sample_index[free[train]] = found[i] >> LANE_BITS
        free[train] += 1


_compile = numba.njit(cache=True, nogil=True, error_model="numpy")
_lay_compiled = _compile(_lay)
add_up = _compile(_add_up)
_find_compiled = _compile(_find)
_distribute_compiled = _compile(_distribute)
