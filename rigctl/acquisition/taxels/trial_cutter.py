"""Where trials begin and end in the taxel samples: at the sync line's rise, to the sample.

Every frame counts the rises modulo 4, so a rise is known even when the frame in which it fell
was lost. A trial's first sample is the first frame that starts after the rise, which is the one
behind the frame in which the count changed; its length is a number of samples, not an edge.

Without a sync wire somebody else says, a little later, which sample was the first: what came
meanwhile is kept and followed then.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.values import Block
from rigctl.wire.taxels.frames import Flag

KEPT_BLOCKS = 100
"""Of 20 samples and more each: two seconds at least, and a poll tells of a rise within 0.1 s."""
_RISES = 0b11


@dataclass(slots=True)
class CutTrial:
    """What arrived of one trial.

    ``first_counter``: board counter of its first sample. ``received`` of ``n_samples`` arrived;
    ``late`` and ``overrun`` count samples flagged so, ``sync_low`` those outside the window in
    which the drum says that its speed is constant. ``start_lost``: the rise fell into a gap, so
    the first sample may be another one. ``by_wire``: cut at the sync line, which alone knows
    ``sync_low``.
    """

    first_counter: int
    n_samples: int
    received: int = 0
    late: int = 0
    overrun: int = 0
    sync_low: int = 0
    seen_to: int = -1
    start_lost: bool = False
    by_wire: bool = True

    @property
    def complete(self) -> bool:
        """Whether the last sample, or one behind it, has come."""
        return self.seen_to >= self.first_counter + self.n_samples - 1


class TrialCutter:
    """Follows the samples and cuts the trial that it was told to expect."""

    def __init__(self) -> None:
        self.trial: CutTrial | None = None
        self.rises = 0
        self._expected: int | None = None
        self._edges: int | None = None
        self._next_counter = -1
        self._kept: list[Block] | None = None

    def expect(self, n_samples: int, by_wire: bool = True) -> None:
        """The next rise, or without the wire :meth:`begin`, begins a trial of so many samples."""
        self.trial = None
        self._expected = n_samples
        self._kept = None if by_wire else []

    def begin(self, first_counter: int) -> None:
        """The expected trial began at that sample, a short while ago."""
        assert self._expected is not None and self._kept is not None
        self.trial = CutTrial(first_counter, self._expected, by_wire=False)
        kept, self._expected, self._kept = self._kept, None, None
        for block in kept:
            self._follow(block)

    def forget(self) -> None:
        """No trial is expected any more; what was cut is dropped."""
        self.trial = None
        self._expected = None
        self._kept = None

    def restart(self) -> None:
        """The board's counters began anew: nothing before now can be continued."""
        self.forget()
        self._edges = None
        self._next_counter = -1

    def feed(self, block: Block) -> list[int]:
        """Follow one block; board counters of the samples that come first after a rise.

        A counter directly behind the block belongs to the next one.
        """
        if self._kept is not None:
            self._kept = [*self._kept[-KEPT_BLOCKS:], block]
        rises = block.edges & _RISES
        if self._edges is not None and bool((rises == self._edges).all()):
            self._follow(block)  # as almost always: nothing rose
            self._next_counter = int(block.counters[-1]) + 1
            return []
        before = rises[:1] if self._edges is None else np.array([self._edges], dtype=np.uint8)
        steps = (np.diff(rises, prepend=before) & _RISES).astype(np.int64)
        changed = np.flatnonzero(steps)
        starts = [int(block.counters[row]) + 1 for row in changed]
        self.rises += int(steps[changed].sum())
        if self._expected is not None and self._kept is None and starts:
            self._begin(starts[0], self._counter_before(block, int(changed[0])))
        self._follow(block)
        self._edges = int(rises[-1])
        self._next_counter = int(block.counters[-1]) + 1
        return starts

    def _counter_before(self, block: Block, row: int) -> int:
        return int(block.counters[row - 1]) + 1 if row else self._next_counter

    def _begin(self, first_counter: int, expected_counter: int) -> None:
        assert self._expected is not None
        lost = expected_counter != first_counter - 1
        self.trial = CutTrial(first_counter, self._expected, start_lost=lost)
        self._expected = None

    def _follow(self, block: Block) -> None:
        trial = self.trial
        if trial is None or trial.complete:
            return
        first, behind = np.searchsorted(
            block.counters, (trial.first_counter, trial.first_counter + trial.n_samples)
        )
        flags = block.flags[first:behind]
        trial.received += len(flags)
        trial.late += _count(flags, Flag.LATE)
        trial.overrun += _count(flags, Flag.OVERRUN)
        if trial.by_wire:
            trial.sync_low += len(flags) - _count(flags, Flag.SYNC)
        trial.seen_to = int(block.counters[-1])


def _count(flags: NDArray[np.uint8], flag: Flag) -> int:
    return int(np.count_nonzero(flags & np.uint8(flag)))
