"""Record a session: take values from the event loop without blocking it, write in a thread.

::

    loop                              recorder's thread (the only one that touches HDF5)
    samples   ─┐
    rows      ─┼─► bounded queue ──►  every 0.06 s, or immediately for a trial, part or end:
    events    ─┤                      take all, append, flush; fsync when a trial ended;
    trials    ─┘                      publish the state of the disk as ``status``

One flush writes everything queued since the last, so a slow disk makes larger batches, not a
longer queue. A failure ends the thread; committed rows stay readable, and ``status.failure``
contains the remedy.
"""

from __future__ import annotations

import json
import os
import threading
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, ClassVar, Self

from rigctl.errors import DiskFault, SessionError
from rigctl.session import layout
from rigctl.session.digests import FIRST_DIGEST
from rigctl.session.header import SessionHeader, describe_mismatch, session_wiring, wirings_match
from rigctl.session.layout import SessionLayout, SessionOutcome, drum_row, trial_row
from rigctl.session.notes import SessionNote, check_note, write_note
from rigctl.session.part import (
    PartReader,
    check_experiment,
    existing_parts,
    layout_of,
    part_paths,
)
from rigctl.session.sensor_layout import describe_difference, layouts_match
from rigctl.session.session import open_session
from rigctl.session.session_reader import SessionReader, highest_number
from rigctl.session.writer import (
    Attempt,
    EncodeTrial,
    RecorderStatus,
    SampleBlock,
    SessionHistory,
    SessionWriter,
    failure_message,
    may_pass,
    probe_disk,
)
from rigctl.session.writer_lock import WriterLock
from rigctl.values import DrumState, Event, Gap, TrialRow


def keep_private(folder: Path) -> None:
    """Close a session's folder and files to other users, those included that are made later.

    Everything that this process makes from now on is private: an engine records for one rig.
    Windows keeps a folder's own permissions. Raises SessionError where the folder is another's.
    """
    os.umask(0o077)
    if not folder.is_dir():
        return
    for path in (folder, *folder.iterdir()):
        if path.is_symlink():
            continue
        try:
            path.chmod(0o700 if path.is_dir() else 0o600)
        except OSError as error:
            raise SessionError(
                f"{path} cannot be made private ({error.strerror}): record into a folder of your "
                "own, or set recording.private = false"
            ) from error


def read_history(folder: Path) -> SessionHistory:
    """Return what the parts in a folder hold; one that cannot be read counts with its number."""
    if not existing_parts(folder):
        return SessionHistory(highest_number(folder))
    with open_session(folder) as session:
        return history_of(session, folder)


def history_of(session: SessionReader, folder: Path) -> SessionHistory:
    """Return what an open session in a folder holds."""
    digests = (part.last_digest for part in reversed(session.parts))
    last = next((digest for digest in digests if digest), FIRST_DIGEST)
    committed = session.trials["trial_id"][session.committed()].tolist()
    return SessionHistory(highest_number(folder), last, frozenset(committed))


def prepare_folder(
    folder: Path,
    header: SessionHeader,
    texts: tuple[str, str],
    resume: bool,
    known: SessionHistory | None = None,
) -> tuple[WriterLock, SessionHistory]:
    """Create the folder, lock it and write the protocol and rig ``texts`` into it.

    Returns the lock and what the folder's parts hold; ``known`` is what they held just now.

    Raises SessionError if the folder holds a session or other texts (without ``resume``), or holds
    none, one of another plan or one of another order of taxels (with ``resume``), or has a living
    writer;
    DiskFault if it is not writable.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except FileExistsError as error:
        raise SessionError(f"{folder} is a file: give the path of a folder") from error
    except OSError as error:
        raise DiskFault(f"cannot make {folder}: {error.strerror}; choose another folder") from error
    lock = WriterLock(folder)
    try:
        history = _read_checked(folder, header, resume, known)
        for name, text in zip((layout.PROTOCOL_FILE, layout.RIG_FILE), texts, strict=True):
            _write_once(folder / name, text, resume)
    except BaseException:
        lock.release()
        raise
    return lock, history


def check_same_world(folder: Path, recorded: Mapping[str, Any], current: Mapping[str, Any]) -> None:
    """Compare the ``world`` of a session's ``simulation`` header with that of the connected rig.

    Both map parameter names to values; a real rig has none. Raises SessionError that names the
    first parameter that differs.
    """
    there = recorded.get("world")
    here = json.loads(json.dumps(current.get("world")))  # turns tuples into lists
    if there == here:
        return
    if there is None or here is None:
        raise SessionError(
            f"{folder} does not say in which simulated world it was recorded: start a new session"
        )
    name = next(n for n in {**there, **here} if there.get(n) != here.get(n))
    raise SessionError(
        f"{folder} was recorded in another world, {name} is {_format(there, name)} there and "
        f"{_format(here, name)} here: resume it in its own world (`rigctl world {folder}` prints "
        "it), or start a new session"
    )


def _format(world: Mapping[str, Any], name: str) -> str:
    return json.dumps(world[name]) if name in world else "absent"


def _write_once(path: Path, text: str, resume: bool) -> None:
    """Write a text beside the parts, whole or not at all; a resumed session keeps the first one.

    Raises SessionError where a new session would keep that of a run without parts.
    """
    try:
        if not path.exists():
            draft = path.with_name(f"{path.name}.partial")
            draft.write_text(text, encoding="utf-8")
            draft.replace(path)
        elif not resume and path.read_text(encoding="utf-8", errors="replace") != text:
            raise SessionError(
                f"{path} is there already and is not that of this run: choose another folder, or "
                "move the file away"
            )
    except OSError as error:
        raise DiskFault(
            f"cannot write {path}: {error.strerror}; make room or choose another disk"
        ) from error


def _read_checked(
    folder: Path, header: SessionHeader, resume: bool, known: SessionHistory | None
) -> SessionHistory:
    """Return what the parts hold; those of a week of interruptions are hundreds, so not twice."""
    if not resume:
        if highest_number(folder):
            raise SessionError(
                f"{folder} already holds a session: continue it with --resume, or choose another "
                "folder"
            )
        return SessionHistory()
    if known is not None and _is_current(folder, header, known):
        return known
    with open_session(folder) as session:
        _check_plan(session.parts[-1], header)
        return history_of(session, folder)


def _is_current(folder: Path, header: SessionHeader, known: SessionHistory) -> bool:
    """Check the last part; return whether it can be read and ends as it did."""
    try:
        last = PartReader(part_paths(folder)[-1])
    except SessionError:
        return False
    try:
        _check_plan(last, header)
        # A part whose writer was killed soon has no digest: then the last one is an earlier part's.
        return last.number == known.last_part and last.last_digest in ("", known.last_digest)
    finally:
        last.close()


def _check_plan(part: PartReader, header: SessionHeader) -> None:
    path, recorded = part.path, part.header
    check_experiment(path.parent, part.layout, layout_of(header.to_attributes(), path))
    wiring = session_wiring(recorded, part.text("/rig_toml"))
    if (recorded.plan_hash, recorded.n_taxels) != (header.plan_hash, header.n_taxels):
        raise SessionError(
            f"{path.parent} was recorded with another protocol or seed: resume it with its own "
            f"{layout.PROTOCOL_FILE}, or start a new session"
        )
    if recorded.reference_um_per_s != header.reference_um_per_s:
        raise SessionError(
            f"{path.parent} has a reference speed of {recorded.reference_um_per_s} µm/s, not of "
            f"{header.reference_um_per_s}: resume it with its own, or start a new session"
        )
    if recorded.highest_reading != header.highest_reading:
        raise SessionError(
            f"{path.parent} has readings of 0 to {recorded.highest_reading}, this rig of 0 to "
            f"{header.highest_reading}: resume it with its own [taxels], or start a new session"
        )
    if not layouts_match(recorded.sensor_layout, header.sensor_layout):
        raise SessionError(
            f"{path.parent} is of a sensor with another layout than this rig has "
            f"({describe_difference(recorded.sensor_layout, header.sensor_layout)}): resume it "
            "with its own [taxels], or start a new session"
        )
    if not wirings_match(header.wiring, wiring):
        raise SessionError(
            f"{path.parent} has its taxels in another order than this rig has "
            f"({describe_mismatch(wiring, header.wiring)}): resume it with its own wiring, "
            "or start a new session"
        )


FLUSH_PERIOD_S = 0.06
"""What a kill may cost, with a batch of 10 ms and the time of a write: less than 0.1 s."""
QUEUE_LIMIT_SAMPLES = 600_000
"""Ten minutes of samples, about 28 MB: longer than any stall that a disk recovers from."""
WAKE_AT_SAMPLES = 20_000
"""A fast simulation reaches this before the flush period ends."""


class SessionRecorder:
    """Writer of one session of any layout. Only ``wait_written`` and ``close`` block.

    A recorder of an experiment adds its layout and its values.

    Creates ``folder`` if necessary; with ``resume`` it must hold a session of the same plan, and
    new parts follow the old ones; ``known`` saves reading those that were just read. Raises
    SessionError while another writer holds the folder or if it holds another session, DiskFault if
    it is not writable.
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
        known: SessionHistory | None = None,
        queue_limit_samples: int = QUEUE_LIMIT_SAMPLES,
    ) -> None:
        self.folder = folder
        self._texts = texts = (protocol_text, rig_text)
        self.header = header = replace(header, experiment=self.layout.experiment)
        self._lock, history = prepare_folder(folder, header, texts, resume, known)
        self._writer = SessionWriter(folder, self.layout, header, texts, history)
        self._actions: deque[tuple[Callable[[], object], int]] = deque()
        self._limit_samples = queue_limit_samples
        self._put_samples = self._taken_samples = 0  # each is changed by one thread only
        self._dropped = 0
        self._overflow: Gap | None = None
        self._failure: str | None = None
        self.may_try_again = False
        """Whether it was the disk that refused, which may take files again later."""
        self._closing = False
        self._outcome: SessionOutcome | None = None
        self._wake = threading.Event()
        self._start_thread()

    def _start_thread(self) -> None:
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)
        self._thread.start()

    @property
    def status(self) -> RecorderStatus:
        """Snapshot, cheap enough for every display update."""
        return replace(self._writer.status, queue_samples=self.queue_samples, failure=self.failure)

    @property
    def failure(self) -> str | None:
        """Reason why data did not reach the disk, with the remedy; None while all data does."""
        if self._failure or not self._dropped:
            return self._failure
        return (
            f"{self._dropped} samples were lost because the disk of {self.folder} cannot keep up: "
            "record on a faster or less busy disk."
        )

    def try_again(self) -> frozenset[int] | None:
        """Go on after the disk had refused, with a new part; return the trials committed on it.

        None while it still refuses. What was added since its last flush is lost.
        """
        self._thread.join()
        texture = self._writer.texture
        try:
            probe_disk(self.folder)
            history = read_history(self.folder)
            self._writer = SessionWriter(
                self.folder, self.layout, self.header, self._texts, history
            )
        except (OSError, SessionError):
            return None
        self._actions.clear()
        self._put_samples = self._taken_samples = self._dropped = 0
        self._overflow = self._failure = None
        self.may_try_again = False
        self._start_thread()
        self.begin_part("the disk takes files again", texture)
        return history.committed

    def begin_part(
        self, reason: str, texture: str = "", header: SessionHeader | None = None
    ) -> None:
        """Start a new file: before the first data, when resuming, at a plate change.

        ``header`` is that of this part and the following ones, of the same plan: a part holds the
        ranges that its spikes were made with.
        """
        self._put_overflow()
        if header is not None:
            self.header = header = replace(header, experiment=self.layout.experiment)
        self._put(partial(self._writer.begin_part, reason, texture, header))
        self._wake.set()

    def add_block(self, block: SampleBlock) -> None:
        """Record samples; if the queue is full, drop them and record a gap."""
        if self._failure is not None:
            return
        if self.queue_samples + len(block) > self._limit_samples:
            self._drop(block)
            return
        self._put_overflow()
        self._put(partial(self._writer.add_block, block), len(block))
        if self.queue_samples >= WAKE_AT_SAMPLES:
            self._wake.set()

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
    def queue_samples(self) -> int:
        """Samples that wait for the disk."""
        return self._put_samples - self._taken_samples

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
            self.may_try_again = may_pass(error)
            self._failure = failure_message(error, self.folder)
            self._writer.abandon()
            self._take()

    def _write_batch(self) -> None:
        for action in self._take():
            action()
        self._writer.flush()


class Recorder(SessionRecorder):
    """Writer of one session of the drum."""

    layout: ClassVar[SessionLayout] = layout.DRUM_LAYOUT

    def add_drum(self, state: DrumState, force_set_g: float, speed_set_mm_s: float) -> None:
        """Record a poll, its new load-cell samples and the set-points at that time."""
        self._put(partial(self._write_drum, state, force_set_g, speed_set_mm_s))

    def commit_trial(self, row: TrialRow) -> None:
        """Record an attempt after its last sample and sync it to the medium immediately.

        The writer derives ``part`` and ``first_sample`` from the row's ``first_counter``.
        """
        self.add_trial(row)
        self._wake.set()

    def add_trial(self, row: TrialRow) -> None:
        """As :meth:`commit_trial`, but with the next flush: it does not wake the thread."""
        self._put_trial(row, partial(trial_row, row))

    def _write_drum(self, state: DrumState, force_set_g: float, speed_set_mm_s: float) -> None:
        poll = drum_row(state, force_set_g, speed_set_mm_s)
        self._writer.add_rows(layout.DRUM, state.at_s, [poll])
        # The table has the fields of a load-cell sample.
        self._writer.add_rows(layout.LOADCELL, state.at_s, state.loadcell)
