"""One scan while it happens: samples in, a velocity out for each batch, windows in.

::

    start ─► samples of batch 0 … ─► its velocity ─► its windows ─► … ─► stop ─► last windows

A batch's velocity is the mean between the times of its first and last sample. It can be sent when
the tracker has passed the batch's end, and must arrive before the next batch is complete;
otherwise the board uses the velocity before it and says so.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rigctl.errors import RigFault
from rigctl.finger.board_messages import (
    BATCH_SAMPLES,
    N_TAXELS,
    Answer,
    BatchReport,
    Message,
    RequestType,
    Result,
    SampleFlag,
    ScanEnded,
    WindowReport,
)
from rigctl.finger.decoder import FingerBlock
from rigctl.finger.driver import Finger
from rigctl.finger.trackers.velocity import BatchVelocity, VelocityEstimator
from rigctl.values import SAMPLE_RATE_HZ

BATCH_S = BATCH_SAMPLES / SAMPLE_RATE_HZ
LAST_VELOCITY_TIMEOUT_S = 0.3
"""How long the last batch waits for the tracker before it uses the velocity before it, and how long
the request to stop waits for its answer before it is repeated."""


@dataclass(frozen=True, slots=True)
class SentVelocity:
    """The velocity that the host sent for a batch, and when, in loop time."""

    batch: int
    estimate: BatchVelocity
    sent_s: float


@dataclass(slots=True)
class ScanData:
    """What has arrived of a scan; arrays grow block by block."""

    first_counter: int = -1
    count: int = 0
    lost_samples: int = 0
    spikes: list[NDArray[np.uint8]] = field(default_factory=list)
    windows: list[WindowReport] = field(default_factory=list)
    batches: list[tuple[BatchReport, float]] = field(default_factory=list)
    sent: dict[int, SentVelocity] = field(default_factory=dict)

    @property
    def all_spikes(self) -> NDArray[np.uint8]:
        """Spikes of all samples so far, uint8 (n, 9)."""
        return np.concatenate([np.zeros((0, N_TAXELS), np.uint8), *self.spikes])


class ScanInProgress:
    """Runs one scan on the board; all calls are in the loop's thread.

    ``on_progress(scan)`` is called when the board has scaled a batch, and at the end. ``ended``:
    the board has sent the last window. ``failure``: why the board did not make the scan, empty
    otherwise.
    """

    def __init__(
        self,
        number: int,
        finger: Finger,
        estimator: VelocityEstimator,
        loop: asyncio.AbstractEventLoop,
        on_progress: Callable[[ScanInProgress], None],
    ) -> None:
        self.number = number
        self.data = ScanData()
        self.ended = False
        self.failure = ""
        self.started_s = loop.time()
        self.ended_s = 0.0
        self._finger = finger
        self._estimator = estimator
        self._loop = loop
        self._on_progress = on_progress
        self._first_sample_s: float | None = None
        self._stopped = self._closed = False
        self._next_batch = 0
        self._timeout: asyncio.TimerHandle | None = None
        estimator.begin_scan()
        finger.send_start(number)

    @property
    def first_sample_s(self) -> float | None:
        """Loop time at which the first sample was taken, None before it has arrived."""
        return self._first_sample_s

    @property
    def duration_s(self) -> float:
        """Length of the samples so far."""
        return self.data.count / SAMPLE_RATE_HZ

    @property
    def distance_mm(self) -> float:
        """Distance of the batches that the board has scaled, by the velocities it used."""
        reports = (report for report, _ in self.data.batches)
        return sum(report.velocity_um_per_s * report.samples for report in reports) / 1e6

    @property
    def scaled_s(self) -> float:
        """Length of the batches that the board has scaled."""
        return sum(report.samples for report, _ in self.data.batches) / SAMPLE_RATE_HZ

    def stop(self) -> None:
        """End the scan with the present sample; :attr:`ended` follows."""
        if not self._stopped and not self.ended:
            self._stopped = True
            self._stop_again_later()
            self._finger.send_stop(self.number)

    def add_block(self, block: FingerBlock, arrived_s: float) -> NDArray[np.intp]:
        """Add the scan's samples of a block, and send the velocities that are known by now.

        Returns their rows in the block, intp (n,).
        """
        rows = self._rows_of_scan(block)
        if len(rows):
            self._add_rows(block, rows, arrived_s)
            self.send_velocities()
        return rows

    def _rows_of_scan(self, block: FingerBlock) -> NDArray[np.intp]:
        """Return the rows from the scan's first sample on: an earlier scan may precede it."""
        rows = np.flatnonzero(block.flags & SampleFlag.IN_SCAN)
        if self.ended:
            return rows[:0]
        if self.data.first_counter < 0:
            firsts = np.flatnonzero(block.flags & SampleFlag.FIRST)
            if not len(firsts):
                return rows[:0]
            rows = rows[rows >= firsts[-1]]
            self.data.first_counter = int(block.counters[firsts[-1]])
        return rows

    def _add_rows(self, block: FingerBlock, rows: NDArray[np.intp], arrived_s: float) -> None:
        last = int(block.counters[rows[-1]]) + 1 - self.data.first_counter
        self.data.lost_samples += last - self.data.count - len(rows)
        self.data.count = last
        self.data.spikes.append(block.spikes[rows])
        taken_s = arrived_s - last / SAMPLE_RATE_HZ
        known_s = self._first_sample_s
        self._first_sample_s = taken_s if known_s is None else min(known_s, taken_s)

    def add_message(self, message: Message, arrived_s: float) -> None:
        """Add what the board reports about this scan."""
        if self.ended or getattr(message, "scan", None) != self.number:
            return
        if isinstance(message, Answer):
            self._add_answer(message)
        elif isinstance(message, WindowReport):
            self.data.windows.append(message)
        elif isinstance(message, BatchReport):
            self._next_batch = max(self._next_batch, message.batch + 1)
            self.data.batches.append((message, arrived_s))
            self._on_progress(self)
        elif isinstance(message, ScanEnded):
            self._end(arrived_s)
            self._on_progress(self)

    def send_velocities(self) -> None:
        """Send the velocity of each complete batch whose end the tracker has passed."""
        while (times := self._next_interval()) is not None and not self.ended:
            estimate = self._estimator.mean_velocity(*times, self._loop.time())
            if estimate is None:
                return
            batch = self._next_batch
            self._next_batch += 1
            self.data.sent[batch] = SentVelocity(batch, estimate, self._loop.time())
            self._finger.set_velocity(self.number, batch, estimate.um_per_s)

    def break_off(self, reason: str) -> None:
        """End the scan at once, because its data cannot be used."""
        self.failure = self.failure or reason
        if not self.ended:
            self._end(self._loop.time())

    def _next_interval(self) -> tuple[float, float] | None:
        """Return the times of the next batch's begin and end; None until it is complete."""
        if self._first_sample_s is None:
            return None
        begin = self._next_batch * BATCH_SAMPLES
        end = begin + BATCH_SAMPLES
        if self.data.count < end:
            if not self._closed or self.data.count <= begin:
                return None
            end = self.data.count
        first_s = self._first_sample_s
        return first_s + begin / SAMPLE_RATE_HZ, first_s + end / SAMPLE_RATE_HZ

    def _add_answer(self, answer: Answer) -> None:
        if answer.request is RequestType.START and answer.result is not Result.OK:
            self.break_off(f"the finger board refused to start: {answer.result.name.lower()}")
        elif answer.request is RequestType.STOP and not self._closed:
            self._closed = True
            self._stop_again_later()
            self.send_velocities()

    def _stop_again_later(self) -> None:
        if self._timeout is not None:
            self._timeout.cancel()
        self._timeout = self._loop.call_later(LAST_VELOCITY_TIMEOUT_S, self._stop_again)

    def _stop_again(self) -> None:
        """Repeat a request that was lost, or end a scan whose last velocity is not known.

        For the last batch the board then uses the velocity before it.
        """
        try:
            self._finger.send_stop(self.number)
        except RigFault as fault:
            self.break_off(str(fault))

    def _end(self, at_s: float) -> None:
        self.ended, self.ended_s = True, at_s
        if self._timeout is not None:
            self._timeout.cancel()
