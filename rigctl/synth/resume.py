"""Resume an unfinished virtual session: inspect it, and record only the missing trials."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from rigctl.errors import SessionError
from rigctl.protocol.plan import Plan
from rigctl.session.files.ground_truth import TRUTH_PATTERN, check_truth
from rigctl.session.format import layout
from rigctl.session.format.header import SessionHeader
from rigctl.session.read.session import Session
from rigctl.session.write.recorder import Recorder
from rigctl.session.write.session_folder import check_same_world
from rigctl.session.write.writer import RecorderStatus
from rigctl.values import Block, DrumState, Event, TrialRow


class ResumedRecorder:
    """A recorder that discards everything until ``attempts`` attempts, which are on disk, passed.

    ``wiring``: the reading of each taxel; blocks arrive in the order of the readings.
    """

    def __init__(self, recorder: Recorder, attempts: int, wiring: Sequence[int]) -> None:
        self._recorder = recorder
        self._order = np.array(wiring, np.intp)
        self._attempts_to_skip = attempts
        self._texture = ""

    @property
    def status(self) -> RecorderStatus:
        return self._recorder.status

    def begin_part(self, reason: str, texture: str) -> None:
        """Begin a new file, unless it exists already."""
        self._texture = texture
        if not self._attempts_to_skip:
            self._recorder.begin_part(reason, texture)

    def add_block(self, block: Block) -> None:
        if not self._attempts_to_skip:
            ordered = np.ascontiguousarray(block.samples[:, self._order])
            self._recorder.add_block(replace(block, samples=ordered))

    def add_drum(self, state: DrumState, force_set_g: float, speed_set_mm_s: float) -> None:
        if not self._attempts_to_skip:
            self._recorder.add_drum(state, force_set_g, speed_set_mm_s)

    def add_event(self, event: Event) -> None:
        if not self._attempts_to_skip:
            self._recorder.add_event(event)

    def add_trial(self, row: TrialRow) -> None:
        """Record an attempt; after the last one on disk, begin a new part."""
        if not self._attempts_to_skip:
            self._recorder.add_trial(row)
            return
        self._attempts_to_skip -= 1
        if not self._attempts_to_skip:
            self._recorder.begin_part("resume", self._texture)

    def wait_written(self) -> None:
        self._recorder.wait_written()


@dataclass(frozen=True, slots=True)
class UnfinishedSession:
    """Content of a session: attempts, committed trials, and whether no trial is missing."""

    attempts: int = 0
    start_utc: str = ""
    complete: bool = False
    committed: int = 0


def inspect_session(folder: Path, header: SessionHeader, plan: Plan) -> UnfinishedSession:
    """Return the content of a session; empty if the folder holds no part yet.

    Raises SessionError if ``header`` and ``plan`` describe another session.
    """
    if not list(folder.glob(layout.PART_PATTERN)):
        return UnfinishedSession()
    with Session.open(folder) as session:
        found = session.header
        _check(folder, found, header)
        attempts = Counter(session.trials["trial_id"].tolist())
        committed = set(session.trials["trial_id"][session.committed()].tolist())
    limit = plan.protocol.quality.attempts
    complete = all(t.trial_id in committed or attempts[t.trial_id] >= limit for t in plan.trials)
    return UnfinishedSession(attempts.total(), found.start_utc, complete, len(committed))


def remove_damaged_truth(folder: Path) -> None:
    """Remove a ground-truth file that an aborted run left unreadable; the new run rewrites it."""
    try:
        check_truth(folder)
    except SessionError:
        for path in folder.glob(TRUTH_PATTERN):
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
