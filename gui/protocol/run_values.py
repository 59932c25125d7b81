"""What the protocol's panels and their worker process exchange. This module does not import Qt."""

from __future__ import annotations

from typing import NamedTuple

PLAN_ROWS = (
    "Plates",
    "Speeds",
    "Forces",
    "Order",
    "Trials",
    "Plate changes",
    "Duration",
    "Disk space",
)
ORDER_COLUMNS = (
    "Trial",
    "Plate",
    "Speed (mm/s)",
    "Force (g)",
    "Depth (mm)",
    "Repeat",
    "Mounting",
)
TRIAL_COLUMNS = (
    "Trial",
    "Plate",
    "Speed\n(mm/s)",
    "Force\n(g)",
    "Repeat",
    "Attempt",
    "Mean speed\n(mm/s)",
    "Mean force\n(g)",
    "Lost\nsamples",
    "Verdict",
    "Reasons",
)
COMMITTED, BAD = "✓ committed", "✗ marked bad"

Row = tuple[str, ...]


class PlanSummary(NamedTuple):
    """The plan of a protocol: a text for each of ``PLAN_ROWS``, and the seed of its order.

    ``order``: a row of ``ORDER_COLUMNS`` for each trial. ``duration_s``: with the changes of
    plates. ``problem`` says why the protocol cannot run; it is empty if it can.
    """

    texts: Row = ("–",) * len(PLAN_ROWS)
    seed: int = 0
    problem: str = ""
    description: str = ""
    order: tuple[Row, ...] = ()
    duration_s: float = 0.0


class AttemptRow(NamedTuple):
    """One attempt at a trial: its numbers, a text for each of ``TRIAL_COLUMNS``."""

    trial_id: int
    attempt: int
    texts: Row

    @property
    def verdict(self) -> str:
        """The text of its verdict."""
        return self.texts[TRIAL_COLUMNS.index("Verdict")]


class SessionNews(NamedTuple):
    """The attempts of a session from number ``first`` on, and all its notes as lines.

    Where ``first`` is 0, the rows replace those before. ``committed``: trials that count in the
    whole session. ``problem``: why it cannot be read, empty if it can. ``early_ends``: a sentence
    for each condition that ended early, with the trials that are not recorded.
    """

    folder: str
    first: int = 0
    rows: tuple[AttemptRow, ...] = ()
    notes: tuple[str, ...] = ()
    committed: int = 0
    problem: str = ""
    early_ends: tuple[str, ...] = ()


class ProtocolText(NamedTuple):
    """The text of a protocol's file, and the path under which a changed one is saved."""

    path: str
    text: str = ""
    own_path: str = ""
    problem: str = ""


class CheckedText(NamedTuple):
    """A text, what it plans, and why it is no protocol; empty if it is one.

    ``key_path`` and ``reason``: which key is wrong, and what is wrong with it; ``line``: from 1.
    """

    text: str
    summary: str = ""
    problem: str = ""
    key_path: tuple[str | int, ...] = ()
    reason: str = ""
    line: int = 0


class SavedProtocol(NamedTuple):
    """The path of a protocol that was saved, and why it was not; empty if it was."""

    path: str
    problem: str = ""
