"""Read many trials from their own memory, a run of eight lanes at a time, with prefetch.

A lane is one taxel of one trial. Most runs are eight neighbouring taxels of one trial, and the
kernel reads them in place. If a trial begins or ends inside a run, the kernel first copies a few
samples side by side, eight neighbouring taxels at a time where there are that many.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.np.numpy_support import carray
from numpy.typing import NDArray

from rigctl.encoder.kernel.simd import (
    VECTOR_WIDTH,
    VECTORS,
    Lanes,
    inline,
    intrinsic,
    pack,
    pointer,
)
from rigctl.errors import WrongUse

READING_BYTES = 2
# Lanes to read at a time, and to copy at a time. A copied run may begin before the lanes needed or
# end behind them; a row of copies has room for that.
RUN = 8
COPY_ROW = 3 * RUN
# A segment is a part of a run with one source: address of its first sample, number of its samples,
# column in a row of copies, and its lanes.
ADDRESS, LENGTH, COLUMN, LANES = range(4)
SEGMENT_FIELDS = 4


@dataclass(frozen=True, slots=True)
class TrialViews:
    """Addresses of the readings of trials, each row after row of all taxels.

    ``addresses``, ``lengths``: int64 (n_trials,); ``row_bytes``: size of a row. ``owners``: arrays
    that must stay in memory meanwhile, as the kernels get addresses only.
    """

    addresses: NDArray[np.int64]
    lengths: NDArray[np.int64]
    row_bytes: int
    owners: Sequence[NDArray[np.uint16]]

    def __len__(self) -> int:
        return len(self.lengths)

    @property
    def n_taxels(self) -> int:
        """Taxels of each trial; 0 without trials."""
        return self.row_bytes // READING_BYTES

    @classmethod
    def from_arrays(cls, trials: Trials) -> TrialViews:
        """Return views of arrays uint16 (n_i, n_taxels), converted and copied only if necessary.

        Raises :class:`WrongUse` for trials with different numbers of taxels.
        """
        if isinstance(trials, TrialViews):
            return trials
        owners = [np.require(samples, np.uint16, ["C", "A"]) for samples in trials]
        shapes = {samples.shape[1:] for samples in owners}
        if len(shapes) > 1 or any(len(shape) != 1 for shape in shapes):
            raise WrongUse(
                f"give trials (n, n_taxels) of the same taxels, not rows of shapes {sorted(shapes)}"
            )
        addresses = np.array([samples.ctypes.data for samples in owners], np.int64)
        row_bytes = READING_BYTES * owners[0].shape[1] if owners else 0
        return cls(addresses, np.array(list(map(len, owners)), np.int64), row_bytes, owners)

    @classmethod
    def from_memory(
        cls, memory: NDArray[np.uint16], starts: NDArray[np.int64], lengths: NDArray[np.int64]
    ) -> TrialViews:
        """Return views of ``lengths`` rows of ``memory``, (rows, n_taxels), from ``starts`` on.

        Raises :class:`WrongUse` for rows outside it.
        """
        memory = np.require(memory, np.uint16, ["C", "A"])
        if (lengths < 0).any() or (starts < 0).any() or (starts + lengths > len(memory)).any():
            raise WrongUse(f"a trial reaches outside its memory of {len(memory)} rows")
        row_bytes = READING_BYTES * memory.shape[1]
        return cls(memory.ctypes.data + starts * row_bytes, lengths, row_bytes, [memory])

    def select(self, which: Any) -> TrialViews:
        """Return the views of some trials: a list of indices, or a slice."""
        return replace(self, addresses=self.addresses[which], lengths=self.lengths[which])


Trials = Sequence[NDArray[np.uint16]] | TrialViews


@intrinsic
def _reading_pointer(_typing: Any, address: Any) -> Any:
    """Return a pointer to the reading at an address."""
    pointer_to: Any = types.CPointer

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.inttoptr(arguments[0], ir.IntType(16).as_pointer())

    return pointer_to(types.uint16)(types.intp), generate


@intrinsic
def _copy_run(_typing: Any, target: Any, index: Any, address: Any) -> Any:
    """Copy :data:`RUN` readings from an address to a flat index of an array."""
    vector = ir.VectorType(ir.IntType(16), RUN)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        copy = pointer(context, builder, signature.args[0], arguments[0], arguments[1], vector)
        source = builder.inttoptr(arguments[2], vector.as_pointer())
        builder.store(builder.load(source, align=2), copy, align=2)
        return context.get_dummy_value()

    return types.void(target, types.intp, types.intp), generate


@intrinsic
def read_run(_typing: Any, address: Any) -> Any:
    """Return :data:`RUN` readings from an address."""
    kind = Lanes("uint16", RUN // VECTOR_WIDTH)
    vector = VECTORS[kind.element]

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        size = READING_BYTES * VECTOR_WIDTH
        offsets = [ir.Constant(ir.IntType(64), size * i) for i in range(kind.vectors)]
        addresses = [builder.add(arguments[0], offset) for offset in offsets]
        pointers = [builder.inttoptr(each, vector.as_pointer()) for each in addresses]
        return pack(builder, [builder.load(each, align=2) for each in pointers])

    return kind(types.intp), generate


@intrinsic
def _prefetch(_typing: Any, address: Any) -> Any:
    """Make the processor load the cache line at an address into its nearest cache."""
    place, option = ir.IntType(8).as_pointer(), ir.IntType(32)

    def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        kind = ir.FunctionType(ir.VoidType(), [place, option, option, option])
        get: Any = cgutils.get_or_insert_function
        instruction = get(builder.module, kind, "llvm.prefetch.p0i8")
        read, high_locality, data = option(0), option(3), option(1)
        target = builder.inttoptr(arguments[0], place)
        builder.call(instruction, [target, read, high_locality, data])
        return context.get_dummy_value()

    return types.void(types.intp), generate


def _follows(addresses: Any, lengths: Any, lane: Any) -> bool:
    """Return whether a lane's readings are next to those of the lane before, in every sample."""
    adjacent: bool = addresses[lane] == addresses[lane - 1] + READING_BYTES
    return adjacent and lengths[lane] == lengths[lane - 1]


def _plan_run(addresses: Any, lengths: Any, first: Any, segments: Any) -> int:
    """Split the run from lane ``first`` on into segments, int64 (8, 4); return their number."""
    n, lane = 0, first
    while lane < first + RUN:
        begin, end = lane, lane + 1
        while begin > max(0, first - RUN) and _follows_compiled(addresses, lengths, begin):
            begin -= 1
        last = min(len(addresses), first + 2 * RUN)
        while end < last and _follows_compiled(addresses, lengths, end):
            end += 1
        width = RUN if end - begin >= RUN else 1
        start = min(lane, end - width)
        segments[n, ADDRESS], segments[n, LENGTH] = addresses[start], lengths[start]
        segments[n, COLUMN], segments[n, LANES] = RUN + start - first, width
        n, lane = n + 1, start + width
    return n


def _gather(segments: Any, n: Any, row_bytes: Any, first: Any, stop: Any, out: Any) -> None:
    """Copy some samples, each into a row of ``out``; behind a trial's end rows do not change.

    Prefetches the readings of the next call.
    """
    ahead = (stop - first) * row_bytes
    for i in range(n):
        address, at = segments[i, ADDRESS] + first * row_bytes, segments[i, COLUMN]
        end = min(stop, segments[i, LENGTH])
        if segments[i, LANES] == RUN:
            for _ in range(first, end):
                _copy_run(out, at, address)
                at, address = at + COPY_ROW, address + row_bytes
        else:
            for _ in range(first, end):
                out[at] = _reading_pointer(address)[0]
                _prefetch(address + ahead)
                at, address = at + COPY_ROW, address + row_bytes


def _first_readings(addresses: Any, lengths: Any, out: Any) -> None:
    """Write the first reading of each lane, 0 where there is none."""
    for lane in range(len(addresses)):
        out[lane] = _reading_pointer(addresses[lane])[0] if lengths[lane] else 0


_compile = numba.njit(cache=True, nogil=True, error_model="numpy")
_follows_compiled, _gather_compiled = _compile(_follows), _compile(_gather)
plan_run, first_readings = _compile(_plan_run), _compile(_first_readings)


@inline
def trial_readings(address: Any, n: Any, n_taxels: Any) -> Any:
    """Return all readings of a trial, uint16 (n, n_taxels), from an address on."""
    return carray(_reading_pointer(address), (n, n_taxels))


@inline
def locate_run(
    segments: Any, n: Any, row_bytes: Any, first: Any, stop: Any, copies: Any
) -> tuple[Any, Any]:
    """Return the address of a run's readings in sample ``first``, and the bytes to the next sample.

    If they are not side by side, first copies the samples to ``copies``, uint16 (samples · 24,).
    """
    if n > 1 or stop > segments[0, LENGTH]:
        _gather_compiled(segments, n, row_bytes, first, stop, copies)
        return copies.ctypes.data + READING_BYTES * RUN, READING_BYTES * COPY_ROW
    return segments[0, ADDRESS] + first * row_bytes, row_bytes


@inline
def prefetch_sample(segments: Any, row_bytes: Any, sample: Any) -> None:
    """Prefetch a later sample's readings: the first segment of each run.

    Other readings of that sample are mostly in the same cache lines.
    """
    for i in range(len(segments)):
        _prefetch(segments[i, 0, ADDRESS] + sample * row_bytes)
