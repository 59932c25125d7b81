"""Resume an unfinished virtual session: inspect it, and record only the missing trials."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from rigctl.errors import SessionError
from rigctl.protocol.plan import Plan
from rigctl.session.ground_truth import check_log, log_paths
from rigctl.session.header import SessionHeader
from rigctl.session.part import existing_parts
from rigctl.session.recorder import Recorder, check_same_world
from rigctl.session.session import Session
from rigctl.session.writer import RecorderStatus
from rigctl.values import Block, DrumState, Event, TrialRow

Attempt = tuple[int, int]
"""The id of a trial and the number of the attempt at it."""


class ResumedRecorder:
    """A recorder that discards the attempts that are on disk.

    Until all of ``on_disk`` have passed, it holds what comes until the attempt's row says whether
    it is one of them. ``wiring``: the reading of each taxel; blocks arrive in the order of the
    readings.
    """

    def __init__(
        self, recorder: Recorder, on_disk: Iterable[Attempt], wiring: Sequence[int]
    ) -> None:
        self._recorder = recorder
        self._order = np.array(wiring, np.intp)
        self._on_disk = set(on_disk)
        self._held: list[Callable[[], None]] = []
        self._part_due = bool(self._on_disk)
        self._texture = ""

    @property
    def status(self) -> RecorderStatus:
        return self._recorder.status

    def begin_part(self, reason: str, texture: str) -> None:
        """Begin a new file, unless it exists already."""
        self._texture = texture
        if not (self._on_disk and self._part_due):  # else a part begins with what comes next
            self._put(partial(self._begin_part, reason, texture))

    def add_block(self, block: Block) -> None:
        self._put(partial(self._add_block, block))

    def add_drum(self, state: DrumState, force_set_g: float, speed_set_mm_s: float) -> None:
        self._put(partial(self._recorder.add_drum, state, force_set_g, speed_set_mm_s))

    def add_event(self, event: Event) -> None:
        self._put(partial(self._recorder.add_event, event))

    def add_trial(self, row: TrialRow) -> None:
        """Record an attempt that is not on disk; after one that is, begin a new part."""
        attempt = row.trial.trial_id, row.attempt
        if attempt in self._on_disk:
            self._on_disk.discard(attempt)
            self._held.clear()
            self._part_due = True
        else:
            self._release()
            self._recorder.add_trial(row)
        if not self._on_disk:
            self._release()

    def wait_written(self) -> None:
        self._recorder.wait_written()

    def _put(self, action: Callable[[], None]) -> None:
        """Do an action, or hold it until the next attempt ends."""
        if self._on_disk:
            self._held.append(action)
        else:
            action()

    def _release(self) -> None:
        """Do what was held, in a new part if something before it was discarded."""
        if self._part_due:
            self._begin_part("resume", self._texture)
        held, self._held = self._held, []
        for action in held:
            action()

    def _begin_part(self, reason: str, texture: str) -> None:
        self._part_due = False
        self._recorder.begin_part(reason, texture)

    def _add_block(self, block: Block) -> None:
        ordered = block.samples.take(self._order, axis=1)
        self._recorder.add_block(replace(block, samples=ordered))


@dataclass(frozen=True, slots=True)
class UnfinishedSession:
    """Content of a session: attempts on disk, committed trials, and whether no trial is missing."""

    attempts: frozenset[Attempt] = frozenset()
    start_utc: str = ""
    complete: bool = False
    committed: int = 0


def inspect_session(folder: Path, header: SessionHeader, plan: Plan) -> UnfinishedSession:
    """Return the content of a session; empty if the folder holds no part yet.

    Raises SessionError if ``header`` and ``plan`` describe another session.
    """
    if not existing_parts(folder):
        return UnfinishedSession()
    with Session.open(folder) as session:
        found = session.header
        _check(folder, found, header)
        rows = np.delete(session.trials, list(session.left_out))
        committed = set(session.trials["trial_id"][session.committed()].tolist())
    attempts = frozenset(zip(rows["trial_id"].tolist(), rows["attempt"].tolist(), strict=True))
    tried = Counter(trial_id for trial_id, _ in attempts)
    limit = plan.protocol.quality.attempts
    complete = all(t.trial_id in committed or tried[t.trial_id] >= limit for t in plan.trials)
    return UnfinishedSession(attempts, found.start_utc, complete, len(committed))


def remove_damaged_truth(folder: Path) -> None:
    """Remove each ground-truth file that cannot be read; the new run writes it again."""
    for path in log_paths(folder):
        try:
            check_log(path)
        except SessionError:
            path.unlink()


def _check(folder: Path, found: SessionHeader, expected: SessionHeader) -> None:
    mismatch = SessionError(
        f"{folder} holds a session of another protocol or seed: choose another folder"
    )
    if (found.rig, found.seed) != (expected.rig, expected.seed):
        raise mismatch
    if _generator(found) != _generator(expected):
        raise SessionError(
            f"{folder} was begun by another version of rigctl or of the simulated bench: finish it "
            "with that one, or choose another folder"
        )
    check_same_world(folder, found.simulation, expected.simulation)
    if found.plan_hash != expected.plan_hash:  # the plan also depends on the world's drum
        raise mismatch


def _generator(header: SessionHeader) -> tuple[Any, ...]:
    return tuple(header.simulation.get(name) for name in ("seed", "method", "generator"))
