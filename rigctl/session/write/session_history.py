"""What a session holds already when a writer begins or resumes it."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from rigctl.errors import SessionError
from rigctl.session.format.digests import FIRST_DIGEST
from rigctl.session.format.layout import PART_PATTERN, part_number
from rigctl.session.read.closing_digest import last_digest
from rigctl.session.read.part import PartReader
from rigctl.values import Verdict


@dataclass(frozen=True, slots=True)
class SessionHistory:
    """The number of the last part, the last digest that can be read, and the committed trials."""

    last_part: int = 0
    last_digest: str = FIRST_DIGEST
    committed: frozenset[int] = frozenset()


def read_history(folder: Path) -> SessionHistory:
    """Return what the parts in a folder hold; a part that cannot be read counts with its number."""
    history = SessionHistory()
    for path in sorted(folder.glob(PART_PATTERN)):
        digest, committed = history.last_digest, history.committed
        with suppress(SessionError):
            part = PartReader(path)
            digest = last_digest(part) or digest
            committed |= _committed(part)
            part.close()
        history = SessionHistory(max(history.last_part, part_number(path)), digest, committed)
    return history


def _committed(part: PartReader) -> frozenset[int]:
    trials = part.rows(part.layout.trials)
    return frozenset(trials["trial_id"][trials["verdict"] == Verdict.COMMITTED.value].tolist())
