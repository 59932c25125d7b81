"""The recorder: takes values from the loop without ever making it wait, writes in its own thread.

::

    loop                              recorder's thread (the only one that touches HDF5)
    add_block ─┐
    add_drum  ─┼─► bounded queue ──►  every 0.25 s, or at once for a trial, a part or the end:
    add_event ─┤                      take all, append, flush; fsync when a trial ended;
    commit_…  ─┘                      publish what is now on disk as ``status``

One flush serves all that came in meanwhile, so a slow disk makes larger batches, not a longer
queue. A failure ends the thread; what was committed stays readable, and ``status.failure``
says what to do.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import TracebackType

from rigctl.errors import DiskFault
from rigctl.session.format import layout
from rigctl.session.format.header import SessionHeader
from rigctl.session.read.folder import part_number, prepare, write_text
from rigctl.session.write.writer import Writer, failure_sentence
from rigctl.values import Block, DrumState, Event, Gap, TrialRow

FLUSH_PERIOD_S = 0.25
QUEUE_LIMIT_SAMPLES = 600_000
"""Ten minutes of samples, about 28 MB: longer than any stall of a disk that comes back."""
WAKE_AT_SAMPLES = 20_000
"""A fast simulation fills this before the flush period is over."""


@dataclass(frozen=True, slots=True)
class RecorderStatus:
    """What is true of the files now; counts are over this recorder's parts.

    ``samples_on_disk``, ``trials_on_disk``: flushed, so another process reads them.
    ``samples_dropped``: lost because the queue was full; each loss is also a gap row.
    ``failure``: one sentence with the cure; the recorder stopped, or lost samples.
    """

    part: int
    samples_accepted: int
    samples_on_disk: int
    samples_dropped: int
    trials_on_disk: int
    bytes_on_disk: int
    disk_free_bytes: int
    queue_blocks: int
    queue_samples: int
    failure: str | None


class Recorder:
    """Writes one session. All methods but ``wait_written`` and ``close`` return at once.

    ``folder`` is made if need be; with ``resume`` it must hold a session of the same plan, and
    new parts follow the old ones. Raises SessionError while another writer has it or where it
    holds another session, DiskFault where it cannot be written.
    """

    def __init__(
        self,
        folder: Path,
        header: SessionHeader,
        protocol_text: str,
        rig_text: str,
        *,
        resume: bool = False,
        queue_limit_samples: int = QUEUE_LIMIT_SAMPLES,
    ) -> None:
        self.folder = folder
        self._lock = prepare(folder, header, resume)
        try:
            write_text(folder / layout.PROTOCOL_FILE, protocol_text)
            write_text(folder / layout.RIG_FILE, rig_text)
        except DiskFault:
            self._lock.release()
            raise
        last = max(map(part_number, folder.glob(layout.PART_PATTERN)), default=0)
        self._writer = Writer(folder, header, (protocol_text, rig_text), last)
        self._mailbox = _Mailbox(queue_limit_samples)
        self._accepted = 0
        self._dropped = 0
        self._overflow: Gap | None = None
        self._failure: str | None = None
        self._closing = False
        self._wake = threading.Event()
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)
        self._thread.start()

    @property
    def left_by(self) -> int | None:
        """Process of an earlier writer that died without closing the session, or None."""
        return self._lock.left_by

    @property
    def status(self) -> RecorderStatus:
        """A snapshot; cheap enough to take at every display tick."""
        disk = self._writer.disk
        return RecorderStatus(
            part=disk.part,
            samples_accepted=self._accepted,
            samples_on_disk=disk.samples,
            samples_dropped=self._dropped,
            trials_on_disk=disk.trials,
            bytes_on_disk=disk.bytes,
            disk_free_bytes=disk.free_bytes,
            queue_blocks=self._mailbox.length,
            queue_samples=self._mailbox.samples,
            failure=self.failure,
        )

    @property
    def failure(self) -> str | None:
        """Why not everything reaches the disk, None while it does."""
        return self._failure or self._overflow_sentence()

    def begin_part(self, reason: str, texture: str) -> None:
        """Start a new file; needed before the first data, at a resume and at a plate change."""
        self._put_overflow()
        self._put(partial(self._writer.begin_part, reason, texture))
        self._wake.set()

    def add_block(self, block: Block) -> None:
        """Record samples; when the queue is full they are dropped and noted as a gap."""
        if self._failure is not None:
            return
        action = partial(self._writer.add_block, block)
        if not self._mailbox.has_room(len(block)):
            self._drop(block)
            return
        self._put_overflow()
        self._put(action, len(block))
        self._accepted += len(block)
        if self._mailbox.samples >= WAKE_AT_SAMPLES:
            self._wake.set()

    def add_drum(self, state: DrumState, force_set_g: float, speed_set_mm_s: float) -> None:
        """Record a poll, its new load-cell samples and the set-points then valid."""
        self._put(partial(self._writer.add_drum, state, force_set_g, speed_set_mm_s))

    def add_event(self, event: Event) -> None:
        """Record an event."""
        self._put(partial(self._writer.add_event, event))

    def commit_trial(self, row: TrialRow) -> None:
        """Record how an attempt ended, after its last sample was added; synced to the medium.

        ``part`` and ``first_sample`` of ``row`` are filled in from its ``first_counter``.
        """
        self.add_trial(row)
        self._wake.set()

    def add_trial(self, row: TrialRow) -> None:
        """As :meth:`commit_trial`, but written with the next flush: others go on meanwhile."""
        self._put(partial(self._writer.commit_trial, row))

    def wait_written(self) -> None:
        """Wait until all that was added is on the medium. Raises DiskFault if it cannot be."""
        done = threading.Event()
        self._put(partial(self._writer.notify_when_written, done))
        self._wake.set()
        while not done.wait(FLUSH_PERIOD_S) and self._thread.is_alive():
            pass
        if self._failure is not None:
            raise DiskFault(self._failure)

    def close(self) -> None:
        """Finish the part, end the thread, release the session; harmless when repeated."""
        self._put_overflow()
        self._closing = True
        self._wake.set()
        self._thread.join()
        self._lock.release()

    def __enter__(self) -> Recorder:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _put(self, action: Callable[[], None], samples: int = 0) -> None:
        if self._failure is None and not self._closing:
            self._mailbox.put(action, samples)

    def _drop(self, block: Block) -> None:
        first = int(block.counters[0])
        if self._overflow is not None:
            first = self._overflow.first_counter
        behind = int(block.counters[-1]) + 1
        self._overflow = Gap(first, behind - first, "recorder queue full")
        self._dropped += len(block)

    def _put_overflow(self) -> None:
        gap, self._overflow = self._overflow, None
        if gap is not None:
            self._put(partial(self._writer.add_gap, gap))

    def _overflow_sentence(self) -> str | None:
        if not self._dropped:
            return None
        return (
            f"{self._dropped} samples were lost because the disk of {self.folder} cannot keep up: "
            "record on a faster or less busy disk."
        )

    def _run(self) -> None:
        try:
            while not self._closing:
                self._wake.wait(FLUSH_PERIOD_S)
                self._wake.clear()
                self._write_batch()
            self._write_batch()
            self._writer.close_part()
        except Exception as error:  # noqa: BLE001 - top of a thread: it becomes a visible fault
            self._failure = failure_sentence(error, self.folder)
            self._writer.abandon()
            self._mailbox.take()

    def _write_batch(self) -> None:
        actions = self._mailbox.take()
        for action in actions:
            action()
        if actions:
            self._writer.flush()
        else:
            self._writer.look_at_disk()


class _Mailbox:
    """A bounded queue from one thread to another; only samples count towards the bound."""

    def __init__(self, limit_samples: int) -> None:
        self._limit = limit_samples
        self._guard = threading.Lock()
        self._actions: list[Callable[[], None]] = []
        self.samples = 0

    @property
    def length(self) -> int:
        """Actions that wait."""
        return len(self._actions)

    def has_room(self, samples: int) -> bool:
        """Whether so many samples more may wait."""
        return self.samples + samples <= self._limit

    def put(self, action: Callable[[], None], samples: int) -> None:
        """Add one action."""
        with self._guard:
            self._actions.append(action)
            self.samples += samples

    def take(self) -> list[Callable[[], None]]:
        """All that waits, oldest first."""
        with self._guard:
            actions, self._actions = self._actions, []
            self.samples = 0
        return actions
