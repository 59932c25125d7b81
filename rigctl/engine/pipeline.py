"""The sample pipeline: every taxel sample, once, from the driver to recorder, encoder and views.

Blocks arrive every few milliseconds. The pipeline merges them into batches, so that the cost per
second does not depend on the driver's block size. Each batch is recorded; where nobody can watch,
several are one for what follows: the search for the sync line's rise, the encoder, the subscribers
and the live file, in this order. The encoder resets at each rise and after each gap of more
than three samples; shorter ones it fills with the sample before. Offline it does the same, so live
and offline spikes of a trial are equal.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.boards.clock_fit import ClockFit
from rigctl.config.rig_config import ADC_MAX
from rigctl.encoder.encoder import Encoder
from rigctl.engine.live_file import LiveWriter
from rigctl.engine.trial_cutter import TrialCutter
from rigctl.session.recorder import Recorder
from rigctl.values import HELD_SAMPLES, SAMPLE_RATE_HZ, Block


class Batching(NamedTuple):
    """How samples are gathered: ``samples`` are recorded together, ``batches`` of them encoded.

    A session has the arrival of each batch, by which its samples are placed in time.
    """

    samples: int
    batches: int


REAL_TIME = Batching(10, 1)
"""At most 10 ms of delay, a hundred batches a second."""
FAST = Batching(100, 10)
"""Where simulated time is faster than real time and no user can watch."""
MAX_QUEUED_SAMPLES = 30_000
"""Longest queue at a simulated bench; with more, its clock stops until the disk has caught up."""
_CLOCK_PERIOD_SAMPLES = 50
_SAMPLE_S = 1.0 / SAMPLE_RATE_HZ
_SMOOTHING = 0.02
_JUMP_S = 0.25


class SamplePipeline:
    """The consumer of the taxel driver's blocks; all calls are in the loop's thread.

    ``waits_for_disk``: the loop's clock stops while this process works, so waiting for the disk
    costs nothing and no sample need be dropped. ``full_scale``: the highest reading.
    """

    def __init__(
        self,
        encoder: Encoder,
        live_writer: LiveWriter,
        *,
        waits_for_disk: bool,
        batching: Batching = REAL_TIME,
        full_scale: int = ADC_MAX,
    ) -> None:
        self.trial_cutter = TrialCutter(full_scale)
        self.clock_fit = ClockFit()
        self.encoder = encoder
        self.sample_count = 0
        self.gap_count = 0
        self.lost_samples = 0
        self.last_arrival_s: float | None = None
        self.last_gap_s: float | None = None
        self._live_writer = live_writer
        self._waits_for_disk = waits_for_disk
        self._batching = batching
        self._recorder: Recorder | None = None
        self._pending: list[Block] = []
        self._pending_samples = 0
        self._recorded: list[Block] = []
        self._newest_counter = -1
        self._next_counter: int | None = None
        self._last_sample: NDArray[np.uint16] | None = None
        self._reset_counter = -1
        self._samples_since_clock = 0
        self._smoothed_time = _SmoothedTime()
        self._subscribers: list[Callable[[Block], object]] = []

    def add_block(self, block: Block) -> None:
        """Accept a block that the driver decoded."""
        if not len(block):
            return
        self._count(block)
        self._pending.append(block)
        self._pending_samples += len(block)
        if self._pending_samples >= self._batching.samples:
            self._record()
            if len(self._recorded) >= self._batching.batches:
                self._process_recorded()

    def flush(self) -> None:
        """Process the pending blocks; call it before any code that must see all samples."""
        self._record()
        self._process_recorded()

    def set_recorder(self, recorder: Recorder | None) -> None:
        """Record from the next sample on, or stop recording where it is None."""
        self.flush()
        self._recorder = recorder

    @property
    def is_recording(self) -> bool:
        """Whether samples go to a recorder now."""
        return self._recorder is not None

    def subscribe(self, subscriber: Callable[[Block], object]) -> Callable[[], None]:
        """Call ``subscriber`` with every batch; return the function that unsubscribes it."""
        self.flush()
        self._subscribers.append(subscriber)
        return partial(self._unsubscribe, subscriber)

    def _unsubscribe(self, subscriber: Callable[[Block], object]) -> None:
        self.flush()
        self._subscribers.remove(subscriber)

    def _record(self) -> None:
        """Record the pending blocks as one batch."""
        blocks, self._pending, self._pending_samples = self._pending, [], 0
        for block in _merge(blocks):
            self._recorded.append(block)
            if self._recorder is None:
                continue
            self._recorder.add_block(block)
            if self._waits_for_disk and self._recorder.queue_samples > MAX_QUEUED_SAMPLES:
                self._recorder.wait_written()

    def _process_recorded(self) -> None:
        blocks, self._recorded = self._recorded, []
        for block in _merge(blocks):
            self._process(block)

    def _process(self, block: Block) -> None:
        if self._next_counter is not None and block.counters[0] < self._next_counter:
            self._reset()
        starts = self.trial_cutter.add_block(block)
        spikes = self._encode(block, starts)
        self.trial_cutter.add_spikes(block, spikes)
        for subscriber in self._subscribers:
            subscriber(block)
        self._live_writer.add_taxels(
            time_s=self._smoothed_time.update(block),
            counters=block.counters,
            samples=block.samples,
            flags=block.flags,
            spikes=spikes,
        )

    def _reset(self) -> None:
        """The board rebooted: its counters restart."""
        self.trial_cutter.reset()
        self._next_counter = None
        self._reset_counter = -1

    def _count(self, block: Block) -> None:
        newest = int(block.counters[-1])
        if newest < self._newest_counter:
            self.clock_fit.reset()  # the board rebooted: its clock restarts
        self._newest_counter = newest
        self.sample_count += len(block)
        if block.gaps:
            self.gap_count += len(block.gaps)
            self.lost_samples += sum(gap.count for gap in block.gaps)
            self.last_gap_s = block.arrived_s
        self.last_arrival_s = block.arrived_s
        self._samples_since_clock += len(block)
        if self._samples_since_clock >= _CLOCK_PERIOD_SAMPLES:
            self._samples_since_clock = 0
            self.clock_fit.add(newest * _SAMPLE_S, block.arrived_s)

    def _encode(self, block: Block, starts: list[int]) -> NDArray[np.uint8]:
        resets = self._reset_rows(block, starts)
        bounds = [0, *[row for row in resets if row], len(block)]
        parts = []
        for start, stop in pairwise(bounds):
            counters, samples = block.counters[start:stop], block.samples[start:stop]
            if start in resets:
                self.encoder.reset()
                self._next_counter = int(counters[0])
            assert self._next_counter is not None
            if counters[-1] - self._next_counter == len(counters) - 1:
                parts.append(self.encoder.encode(np.ascontiguousarray(samples)))
            else:
                parts.append(self._encode_held(counters, samples, self._next_counter))
            self._next_counter, self._last_sample = int(counters[-1]) + 1, samples[-1]
        return np.concatenate(parts) if len(parts) > 1 else parts[0]

    def _encode_held(
        self, counters: NDArray[np.int64], samples: NDArray[np.uint16], next_counter: int
    ) -> NDArray[np.uint8]:
        """Encode with lost samples held; their spikes count for the sample after them."""
        steps = np.diff(counters, prepend=next_counter - 1)
        before = samples[:1] if self._last_sample is None else self._last_sample[None]
        repeats = np.concatenate([steps[:1] - 1, steps[1:], [1]])
        held = np.repeat(np.concatenate([before, samples]), repeats, axis=0)
        first = np.cumsum(steps) - steps
        return np.add.reduceat(self.encoder.encode(held), first, axis=0, dtype=np.uint8)

    def _reset_rows(self, block: Block, starts: list[int]) -> list[int]:
        """Return the rows before which the encoder resets: after long gaps and at trial starts."""
        counters, next_counter = block.counters, self._next_counter
        if (
            not starts
            and counters[0] == next_counter
            and counters[0] != self._reset_counter
            and counters[-1] - counters[0] == len(block) - 1
        ):
            return []
        rows = set((np.flatnonzero(np.diff(counters) > HELD_SAMPLES + 1) + 1).tolist())
        is_held = next_counter is not None and counters[0] - next_counter <= HELD_SAMPLES
        if not is_held or counters[0] == self._reset_counter:
            rows.add(0)
        within = [start for start in starts if start <= counters[-1]]
        rows.update(np.searchsorted(counters, within).tolist())
        self._reset_counter = starts[-1] if starts and starts[-1] > counters[-1] else -1
        return sorted(rows)


class _SmoothedTime:
    """Loop times of samples: the board's even pace, drawn slowly towards the arrivals."""

    def __init__(self) -> None:
        self._counter = 0
        self._time_s = 0.0

    def update(self, block: Block) -> NDArray[np.float64]:
        """Return the loop time of each sample of the block, float64 (n,)."""
        newest = int(block.counters[-1])
        predicted_s = self._time_s + (newest - self._counter) * _SAMPLE_S
        error_s = block.arrived_s - predicted_s
        predicted_s += error_s if abs(error_s) > _JUMP_S else _SMOOTHING * error_s
        self._counter, self._time_s = newest, predicted_s
        return predicted_s - (newest - block.counters).astype(np.float64) * _SAMPLE_S


def _merge(blocks: list[Block]) -> list[Block]:
    """Return the samples in as few blocks as possible: a new one where the counters fall back."""
    runs: list[list[Block]] = []
    for block in blocks:
        if runs and block.counters[0] > runs[-1][-1].counters[-1]:
            runs[-1].append(block)
        else:
            runs.append([block])
    return [_concatenate(run) if len(run) > 1 else run[0] for run in runs]


def _concatenate(blocks: list[Block]) -> Block:
    return Block(
        np.concatenate([block.counters for block in blocks]),
        np.concatenate([block.samples for block in blocks]),
        np.concatenate([block.flags for block in blocks]),
        np.concatenate([block.edges for block in blocks]),
        tuple(gap for block in blocks for gap in block.gaps),
        blocks[-1].arrived_s,
    )
