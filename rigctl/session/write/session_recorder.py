"""Record a session: take values from the event loop without blocking it, write in a thread.

::

    loop                              recorder's thread (the only one that touches HDF5)
    samples   ─┐
    rows      ─┼─► bounded queue ──►  every 0.25 s, or immediately for a trial, part or end:
    events    ─┤                      take all, append, flush; fsync when a trial ended;
    trials    ─┘                      publish the state of the disk as ``status``

One flush writes everything queued since the last, so a slow disk makes larger batches, not a
longer queue. A failure ends the thread; committed rows stay readable, and ``status.failure``
contains the remedy.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import ClassVar, Self

from rigctl.errors import DiskFault
from rigctl.session.format.data_sets import SessionLayout
from rigctl.session.format.layout import SessionOutcome
from rigctl.session.format.metadata.header import SessionHeader
from rigctl.session.notes.session_note import SessionNote, check_note
from rigctl.session.notes.write_note import write_note
from rigctl.session.write.part_writer import SampleBlock
from rigctl.session.write.session_folder import prepare_folder
from rigctl.session.write.session_history import read_history
from rigctl.session.write.writer import (
    Attempt,
    EncodeTrial,
    RecorderStatus,
    SessionWriter,
    failure_message,
)
from rigctl.values import Event, Gap

FLUSH_PERIOD_S = 0.25
QUEUE_LIMIT_SAMPLES = 600_000
"""Ten minutes of samples, about 28 MB: longer than any stall that a disk recovers from."""
WAKE_AT_SAMPLES = 20_000
"""A fast simulation reaches this before the flush period ends."""


class SessionRecorder:
    """Writer of one session of any layout. Only ``wait_written`` and ``close`` block.

    A recorder of an experiment adds its layout and its values.

    Creates ``folder`` if necessary; with ``resume`` it must hold a session of the same plan, and
    new parts follow the old ones. Raises SessionError while another writer holds the folder or if
    it holds another session, DiskFault if it is not writable.
    """

    layout: ClassVar[SessionLayout]

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
        texts = (protocol_text, rig_text)
        self.header = header = replace(header, experiment=self.layout.experiment)
        self._lock = prepare_folder(folder, header, texts, resume)
        self._writer = SessionWriter(folder, self.layout, header, texts, read_history(folder))
        self._actions: deque[tuple[Callable[[], object], int]] = deque()
        self._limit_samples = queue_limit_samples
        self._put_samples = self._taken_samples = 0  # each is changed by one thread only
        self._dropped = 0
        self._overflow: Gap | None = None
        self._failure: str | None = None
        self._closing = False
        self._outcome: SessionOutcome | None = None
        self._wake = threading.Event()
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)
        self._thread.start()

    @property
    def status(self) -> RecorderStatus:
        """Snapshot, cheap enough for every display update."""
        return replace(self._writer.status, queue_samples=self._queue_samples, failure=self.failure)

    @property
    def failure(self) -> str | None:
        """Reason why data did not reach the disk, with the remedy; None while all data does."""
        if self._failure or not self._dropped:
            return self._failure
        return (
            f"{self._dropped} samples were lost because the disk of {self.folder} cannot keep up: "
            "record on a faster or less busy disk."
        )

    def add_event(self, event: Event) -> None:
        """Record an event."""
        self._put(partial(self._writer.add_event, event))

    def add_note(self, note: SessionNote) -> None:
        """Write a note beside the parts; the record itself does not change."""
        self._put(partial(write_note, self.folder, check_note(note)))
        self._wake.set()

    def wait_written(self) -> None:
        """Wait until all added data is on the medium. Raises DiskFault if writing failed."""
        done = threading.Event()
        self._put(self._writer.sync)
        self._put(done.set)
        self._wake.set()
        while not done.wait(FLUSH_PERIOD_S) and self._thread.is_alive():
            pass
        if self._failure is not None:
            raise DiskFault(self._failure)

    @property
    def closing_digest(self) -> str:
        """The digest of the whole session, 64 hexadecimal digits; empty before it is closed."""
        return self._writer.closing_digest

    def close(self, outcome: SessionOutcome | None = None) -> None:
        """Close the session, end the thread and unlock the folder; further calls do nothing.

        Without an ``outcome``, the session is finished if every planned trial is committed, and
        stopped if not.
        """
        self._put_overflow()
        self._outcome = outcome
        self._closing = True
        self._wake.set()
        self._thread.join()
        self._lock.release()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        failed = kind is not None and issubclass(kind, Exception)
        self.close(SessionOutcome.FAILED if failed else None)

    @property
    def _queue_samples(self) -> int:
        return self._put_samples - self._taken_samples

    def _begin_part(self, reason: str, texture: str, header: SessionHeader | None = None) -> None:
        self._put_overflow()
        if header is not None:
            header = replace(header, experiment=self.layout.experiment)
        self._put(partial(self._writer.begin_part, reason, texture, header))
        self._wake.set()

    def _put_block(self, block: SampleBlock) -> None:
        """Record samples; if the queue is full, drop them and record a gap."""
        if self._failure is not None:
            return
        if self._queue_samples + len(block) > self._limit_samples:
            self._drop(block)
            return
        self._put_overflow()
        self._put(partial(self._writer.add_block, block), len(block))
        if self._queue_samples >= WAKE_AT_SAMPLES:
            self._wake.set()

    def _put_trial(self, row: Attempt, encode: EncodeTrial) -> None:
        """Record an attempt with the next flush, which then syncs the file."""
        self._put(partial(self._writer.commit_trial, row, encode))

    def _put(self, action: Callable[[], object], samples: int = 0) -> None:
        if self._failure is None and not self._closing:
            self._put_samples += samples
            self._actions.append((action, samples))

    def _take(self) -> list[Callable[[], object]]:
        """Remove and return all actions, oldest first."""
        taken = [self._actions.popleft() for _ in range(len(self._actions))]
        self._taken_samples += sum(samples for _, samples in taken)
        return [action for action, _ in taken]

    def _drop(self, block: SampleBlock) -> None:
        first = min([int(block.counters[0]), *(gap.first_counter for gap in block.gaps)])
        if self._overflow is not None:
            first = self._overflow.first_counter
        end = int(block.counters[-1]) + 1
        self._overflow = Gap(first, end - first, "recorder queue full")
        self._dropped += len(block)

    def _put_overflow(self) -> None:
        gap, self._overflow = self._overflow, None
        if gap is not None:
            self._put(partial(self._writer.add_gap, gap))

    def _run(self) -> None:
        try:
            while not self._closing:
                self._wake.wait(FLUSH_PERIOD_S)
                self._wake.clear()
                self._write_batch()
            self._write_batch()
            self._writer.end_session(self._outcome)
        except Exception as error:  # noqa: BLE001 - top of a thread: `failure` reports it
            self._failure = failure_message(error, self.folder)
            self._writer.abandon()
            self._take()

    def _write_batch(self) -> None:
        for action in self._take():
            action()
        self._writer.flush()
