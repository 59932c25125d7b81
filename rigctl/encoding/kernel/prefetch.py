"""Readings of many trials where they lie, eight lanes at a time.

A lane is a taxel of a trial. Mostly eight neighbouring lanes are neighbouring taxels, and are read
where they are. Where a trial begins or ends among them, a few samples are copied side by side
beforehand, in runs of eight where that many taxels are neighbours.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numpy.typing import NDArray

from rigctl.encoding.kernel.simd import VECTORS, WIDE, Lanes, emitted, inlined, pointer, whole
from rigctl.errors import WrongUse

BYTES = 2
# Lanes that are read at a time, and copied at a time. A run may begin before the lanes that are
# asked for or end behind them; a copy's row has room for that.
RUN = 8
ROW = 3 * RUN
# What is known of a piece: where its first sample lies, its samples, its place in a row, its lanes.
ADDRESS, LENGTH, PLACE, WIDTH = range(4)
PIECE = 4


@dataclass(frozen=True, slots=True)
class TrialRows:
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
    def of(cls, trials: Trials) -> TrialRows:
        """Of arrays uint16 (n_i, n_taxels), or what can be made such; one that is made stays.

        Raises :class:`WrongUse` for trials of unlike numbers of taxels.
        """
        if isinstance(trials, TrialRows):
            return trials
        held = [np.require(samples, np.uint16, ["C", "A"]) for samples in trials]
        shapes = {samples.shape[1:] for samples in held}
        if len(shapes) > 1 or any(len(shape) != 1 for shape in shapes):
            raise WrongUse(f"trials of samples of shapes {sorted(shapes)} side by side")
        at = np.array([samples.ctypes.data for samples in held], np.int64)
        row_bytes = BYTES * held[0].shape[1] if held else 0
        return cls(at, np.array(list(map(len, held)), np.int64), row_bytes, held)

    @classmethod
    def within(
        cls, memory: NDArray[np.uint16], begins: NDArray[np.int64], lengths: NDArray[np.int64]
    ) -> TrialRows:
        """Of trials in one ``memory``, (rows, n_taxels): ``lengths`` rows of it from ``begins`` on.

        Raises :class:`WrongUse` for rows that it does not have.
        """
        memory = np.require(memory, np.uint16, ["C", "A"])
        if (lengths < 0).any() or (begins < 0).any() or (begins + lengths > len(memory)).any():
            raise WrongUse(f"trials beyond the ends of a memory of {len(memory)} rows")
        row_bytes = BYTES * memory.shape[1]
        return cls(memory.ctypes.data + begins * row_bytes, lengths, row_bytes, [memory])

    def some(self, which: Any) -> TrialRows:
        """Of some trials: a list of indices, or a slice."""
        return replace(self, addresses=self.addresses[which], lengths=self.lengths[which])


Trials = Sequence[NDArray[np.uint16]] | TrialRows


@emitted
def reading(_typing: Any, address: Any) -> Any:
    """The reading at an address in memory."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.load(builder.inttoptr(arguments[0], ir.IntType(16).as_pointer()), align=2)

    return types.uint16(types.intp), generate


@emitted
def _pointer(_typing: Any, address: Any) -> Any:
    pointer_to: Any = types.CPointer

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.inttoptr(arguments[0], ir.IntType(16).as_pointer())

    return pointer_to(types.uint16)(types.intp), generate


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


@emitted
def read_run(_typing: Any, address: Any) -> Any:
    """A run of readings from an address in memory."""
    kind = Lanes("uint16", RUN // WIDE)
    vector = VECTORS[kind.element]

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        starts = [ir.Constant(ir.IntType(64), BYTES * WIDE * i) for i in range(kind.vectors)]
        places = [builder.add(arguments[0], start) for start in starts]
        pointers = [builder.inttoptr(place, vector.as_pointer()) for place in places]
        return whole(builder, [builder.load(each, align=2) for each in pointers])

    return kind(types.intp), generate


@emitted
def _call_up(_typing: Any, address: Any) -> Any:
    """Have the processor bring what lies at an address in memory into its nearest cache."""
    place, how = ir.IntType(8).as_pointer(), ir.IntType(32)

    def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        kind = ir.FunctionType(ir.VoidType(), [place, how, how, how])
        get: Any = cgutils.get_or_insert_function
        prefetch = get(builder.module, kind, "llvm.prefetch.p0i8")
        to_read, to_keep, data = how(0), how(3), how(1)
        where = builder.inttoptr(arguments[0], place)
        builder.call(prefetch, [where, to_read, to_keep, data])
        return context.get_dummy_value()

    return types.void(types.intp), generate


def _follows(addresses: Any, lengths: Any, lane: Any) -> bool:
    """Whether a lane's readings lie right behind those of the lane before, in every sample."""
    near: bool = addresses[lane] == addresses[lane - 1] + BYTES
    return near and lengths[lane] == lengths[lane - 1]


def _planned(addresses: Any, lengths: Any, first: Any, pieces: Any) -> int:
    """In what pieces eight lanes are to be had, int64 (8, 4): how many."""
    n, lane = 0, first
    while lane < first + RUN:
        begin, end = lane, lane + 1
        while begin > max(0, first - RUN) and _follows_compiled(addresses, lengths, begin):
            begin -= 1
        last = min(len(addresses), first + 2 * RUN)
        while end < last and _follows_compiled(addresses, lengths, end):
            end += 1
        wide = RUN if end - begin >= RUN else 1
        at = min(lane, end - wide)
        pieces[n, ADDRESS], pieces[n, LENGTH] = addresses[at], lengths[at]
        pieces[n, PLACE], pieces[n, WIDTH] = RUN + at - first, wide
        n, lane = n + 1, at + wide
    return n


def _gather(pieces: Any, n: Any, row_bytes: Any, first: Any, stop: Any, out: Any) -> None:
    """Copy some samples, a row of ``out`` each; a trial that has ended leaves what is there.

    The readings so many samples on are called up: it will be their turn next.
    """
    ahead = (stop - first) * row_bytes
    for i in range(n):
        address, at = pieces[i, ADDRESS] + first * row_bytes, pieces[i, PLACE]
        own = min(stop, pieces[i, LENGTH])
        if pieces[i, WIDTH] == RUN:
            for _ in range(first, own):
                copy_run(out, at, address)
                at, address = at + ROW, address + row_bytes
        else:
            for _ in range(first, own):
                out[at] = reading(address)
                _call_up(address + ahead)
                at, address = at + ROW, address + row_bytes


def _first(addresses: Any, lengths: Any, out: Any) -> None:
    """The first reading of each lane, 0 where there is none."""
    for lane in range(len(addresses)):
        out[lane] = reading(addresses[lane]) if lengths[lane] else 0


_compile = numba.njit(cache=True, nogil=True, error_model="numpy")
_follows_compiled = _compile(_follows)
planned, gather, first_readings = _compile(_planned), _compile(_gather), _compile(_first)


@inlined
def readings_of(address: Any, n: Any, n_taxels: Any) -> Any:
    """All readings of a trial, uint16 (n, n_taxels), from an address in memory on."""
    return numba.carray(_pointer(address), (n, n_taxels))  # type: ignore[attr-defined]  # numba has no type information


@inlined
def found(
    pieces: Any, n: Any, row_bytes: Any, first: Any, stop: Any, copies: Any
) -> tuple[Any, Any]:
    """Where eight lanes' readings lie in some samples: the first one's address, and bytes a row.

    Copied to ``copies``, uint16 (samples · 24,), if they do not lie side by side.
    """
    if n > 1 or stop > pieces[0, LENGTH]:
        gather(pieces, n, row_bytes, first, stop, copies)
        return copies.ctypes.data + BYTES * RUN, BYTES * ROW
    return pieces[0, ADDRESS] + first * row_bytes, row_bytes


@inlined
def call_up(pieces: Any, row_bytes: Any, sample: Any) -> None:
    """Have a sample's readings at hand when it comes to it: of each eight lanes the first piece's.

    Readings of the same sample that lie beside them mostly come with them.
    """
    for i in range(len(pieces)):
        _call_up(pieces[i, 0, ADDRESS] + sample * row_bytes)
