"""What a session holds already when a writer begins or resumes it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from rigctl.session.format.digests import FIRST_DIGEST
from rigctl.session.open_session import open_session
from rigctl.session.read.closing_digest import last_digest
from rigctl.session.read.missing_parts import highest_number
from rigctl.session.read.part_file import existing_parts


@dataclass(frozen=True, slots=True)
class SessionHistory:
    """The number of the last part, the last digest that can be read, and the committed trials."""

    last_part: int = 0
    last_digest: str = FIRST_DIGEST
    committed: frozenset[int] = frozenset()


def read_history(folder: Path) -> SessionHistory:
    """Return what the parts in a folder hold; one that cannot be read counts with its number."""
    if not existing_parts(folder):
        return SessionHistory(highest_number(folder))
    with open_session(folder) as session:
        digests = [digest for part in session.parts if (digest := last_digest(part))]
        committed = session.trials["trial_id"][session.committed()].tolist()
    last = digests[-1] if digests else FIRST_DIGEST
    return SessionHistory(highest_number(folder), last, frozenset(committed))
