"""The pump: every taxel sample, once, from the driver to the recorder, the encoder and the eye.

Blocks arrive every few milliseconds and are gathered, to about twenty samples, so that a second
costs fifty turns of the pump whatever the driver's slices are. What is gathered is, in this
order: recorded, searched for the sync line's rise, encoded, shown. The encoder starts anew at
each rise and behind each gap, exactly as it does offline, so live and offline spikes of a trial
are equal.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rigctl.acquisition.live_buffer import LiveWriter
from rigctl.acquisition.taxels.clock_fit import ClockFit
from rigctl.acquisition.taxels.trial_cutter import TrialCutter
from rigctl.session.write.recorder import Recorder
from rigctl.values import SAMPLE_RATE_HZ, Block

WATCHED_SAMPLES = 20
"""Gathered where people watch: 20 ms late at most."""
UNWATCHED_SAMPLES = 100
"""Gathered where the world runs ahead of our time, and nobody can watch."""
STANDING_SAMPLES = 30_000
"""A world that stands still while we work is made to wait for the disk from here on."""
_CLOCK_EVERY_SAMPLES = 50
_SAMPLE_S = 1.0 / SAMPLE_RATE_HZ
_PULL = 0.02
_JUMP_S = 0.25


class LiveEncoder(Protocol):
    """Samples to spikes, a slice at a time, equal for any slicing."""

    def reset(self) -> None:
        """Start at rest with the next sample."""
        ...

    def encode(self, samples: NDArray[np.uint16]) -> NDArray[np.uint8]:
        """uint16 (n, n_taxels) to spikes a sample, uint8 (n, 2·n_taxels)."""
        ...


class SamplePipeline:
    """One consumer of the taxel driver's blocks; all calls are in the loop's thread.

    ``time_stands``: the loop's clock stands still while this process works, so waiting for the
    disk costs nothing and no sample need ever be dropped. ``gather``: samples a turn.
    """

    def __init__(
        self,
        encoder: LiveEncoder,
        live: LiveWriter,
        *,
        time_stands: bool,
        gather: int = WATCHED_SAMPLES,
    ) -> None:
        self.cutter = TrialCutter()
        self.clock = ClockFit()
        self.encoder = encoder
        self.samples = 0
        self.gaps = 0
        self.lost_samples = 0
        self.last_arrival_s: float | None = None
        self._live = live
        self._time_stands = time_stands
        self._gather = gather
        self._recorder: Recorder | None = None
        self._pending: list[Block] = []
        self._pending_samples = 0
        self._next_counter: int | None = None
        self._anew_at = -1
        self._clock_samples = 0
        self._unwritten = 0
        self._shown = _ShownTime()
        self._watchers: list[Callable[[Block], None]] = []

    def take(self, block: Block) -> None:
        """Accept what the driver decoded."""
        self._pending.append(block)
        self._pending_samples += len(block)
        if self._pending_samples >= self._gather:
            self.flush()

    def flush(self) -> None:
        """Pass on what was gathered; called before anything that must see all samples."""
        blocks, self._pending, self._pending_samples = self._pending, [], 0
        for block in _gather(blocks):
            self._pass_on(block)

    def record_to(self, recorder: Recorder | None) -> None:
        """From the next sample on, record there, or nowhere."""
        self.flush()
        self._recorder = recorder

    @property
    def recording(self) -> bool:
        """Whether samples go to a recorder now."""
        return self._recorder is not None

    def watch(self, watcher: Callable[[Block], None]) -> Callable[[], None]:
        """Show every block to ``watcher`` too; the answer ends that."""
        self._watchers.append(watcher)
        return lambda: self._watchers.remove(watcher)

    def _pass_on(self, block: Block) -> None:
        if self._next_counter is not None and block.counters[0] < self._next_counter:
            self._restart()
        self._count(block)
        if self._recorder is not None:
            self._recorder.add_block(block)
            self._unwritten += len(block)
            if self._time_stands and self._unwritten > STANDING_SAMPLES // 4:
                self._wait_for_disk(self._recorder)
        starts = self.cutter.feed(block)
        spikes = self._encode(block, starts)
        for watcher in self._watchers:
            watcher(block)
        times = self._shown.of(block)
        self._live.add_taxels(times, block.counters, block.samples, block.flags, spikes)

    def _restart(self) -> None:
        """The board rebooted: its counters and its clock begin anew."""
        self.cutter.restart()
        self.clock.restart()
        self._next_counter = None
        self._anew_at = -1

    def _count(self, block: Block) -> None:
        self.samples += len(block)
        self.gaps += len(block.gaps)
        self.lost_samples += sum(gap.count for gap in block.gaps)
        self.last_arrival_s = block.arrived_s
        self._clock_samples += len(block)
        if self._clock_samples >= _CLOCK_EVERY_SAMPLES:
            self._clock_samples = 0
            self.clock.add(int(block.counters[-1]) * _SAMPLE_S, block.arrived_s)

    def _wait_for_disk(self, recorder: Recorder) -> None:
        self._unwritten = 0
        if recorder.status.queue_samples > STANDING_SAMPLES:
            recorder.wait_written()

    def _encode(self, block: Block, starts: list[int]) -> NDArray[np.uint8]:
        anew = self._rows_that_start_anew(block, starts)
        self._next_counter = int(block.counters[-1]) + 1
        if not anew:
            return self.encoder.encode(block.samples)
        bounds = [0, *[row for row in anew if row], len(block)]
        parts = []
        for first, behind in pairwise(bounds):
            if first in anew:
                self.encoder.reset()
            parts.append(self.encoder.encode(np.ascontiguousarray(block.samples[first:behind])))
        return np.concatenate(parts)

    def _rows_that_start_anew(self, block: Block, starts: list[int]) -> list[int]:
        counters = block.counters
        if (
            not starts
            and counters[0] == self._next_counter
            and counters[0] != self._anew_at
            and counters[-1] - counters[0] == len(block) - 1
        ):
            return []
        rows = set((np.flatnonzero(np.diff(counters) != 1) + 1).tolist())
        if counters[0] != self._next_counter or counters[0] == self._anew_at:
            rows.add(0)
        within = [start for start in starts if start <= counters[-1]]
        rows.update(np.searchsorted(counters, within).tolist())
        self._anew_at = starts[-1] if starts and starts[-1] > counters[-1] else -1
        return sorted(rows)


class _ShownTime:
    """Loop times for samples: the board's even pace, pulled gently towards the arrivals."""

    def __init__(self) -> None:
        self._counter = 0
        self._time_s = 0.0

    def of(self, block: Block) -> NDArray[np.float64]:
        """float64 (n,), the loop time shown for each sample of the block."""
        newest = int(block.counters[-1])
        guess = self._time_s + (newest - self._counter) * _SAMPLE_S
        error = block.arrived_s - guess
        guess += error if abs(error) > _JUMP_S else _PULL * error
        self._counter, self._time_s = newest, guess
        before = (newest - block.counters).astype(np.float64)
        return guess - before * _SAMPLE_S


def _gather(blocks: list[Block]) -> list[Block]:
    """The same samples in as few blocks as can be: a new one where the counters fall back."""
    runs: list[list[Block]] = []
    for block in blocks:
        if not len(block):
            continue
        if runs and block.counters[0] > runs[-1][-1].counters[-1]:
            runs[-1].append(block)
        else:
            runs.append([block])
    return [_join(run) if len(run) > 1 else run[0] for run in runs]


def _join(blocks: list[Block]) -> Block:
    return Block(
        np.concatenate([block.counters for block in blocks]),
        np.concatenate([block.samples for block in blocks]),
        np.concatenate([block.flags for block in blocks]),
        np.concatenate([block.edges for block in blocks]),
        tuple(gap for block in blocks for gap in block.gaps),
        blocks[-1].arrived_s,
    )
