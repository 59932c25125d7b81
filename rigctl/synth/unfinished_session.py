"""What an unfinished virtual session holds, and whether it can be gone on with."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rigctl.errors import SessionError
from rigctl.protocol import Plan
from rigctl.session.files.ground_truth import TRUTH_PATTERN, check_truth
from rigctl.session.format import layout
from rigctl.session.format.header import SessionHeader
from rigctl.session.read.session import Session
from rigctl.session.write.session_folder import check_same_world


@dataclass(frozen=True, slots=True)
class UnfinishedSession:
    """``attempts`` at trials are in the session; ``complete`` when none is left to make."""

    attempts: int = 0
    start_utc: str = ""
    complete: bool = False
    committed: int = 0


def look(folder: Path, header: SessionHeader, plan: Plan) -> UnfinishedSession:
    """What is there; nothing where the folder holds no part yet.

    Raises SessionError where it is another session than ``header`` and ``plan`` would make.
    """
    if not list(folder.glob(layout.PART_PATTERN)):
        return UnfinishedSession()
    with Session.open(folder) as session:
        found = session.header
        _check(folder, found, header)
        tried = Counter(session.trials["trial_id"].tolist())
        committed = set(session.trials["trial_id"][session.committed()].tolist())
    most = plan.protocol.quality.attempts
    complete = all(t.trial_id in committed or tried[t.trial_id] >= most for t in plan.trials)
    return UnfinishedSession(tried.total(), found.start_utc, complete, len(committed))


def forget_damaged_truth(folder: Path) -> None:
    """Remove a log of the world that a kill left unreadable: the world writes it anew."""
    try:
        check_truth(folder)
    except SessionError:
        for path in folder.glob(TRUTH_PATTERN):
            path.unlink()


def _check(folder: Path, found: SessionHeader, wanted: SessionHeader) -> None:
    another = SessionError(
        f"{folder} holds another session than this protocol and seed make: choose another folder"
    )
    if (found.rig, found.seed) != (wanted.rig, wanted.seed):
        raise another
    if _method(found) != _method(wanted):
        raise SessionError(
            f"{folder} was begun by another version of rigctl or of the simulated bench: finish it "
            "with that one, or choose another folder"
        )
    check_same_world(folder, found.simulation, wanted.simulation)
    if found.plan_hash != wanted.plan_hash:  # it follows the world's drum too
        raise another


def _method(header: SessionHeader) -> tuple[Any, ...]:
    return tuple(header.simulation.get(name) for name in ("seed", "method", "generator"))
