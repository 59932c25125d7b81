"""What clients see of an engine's setup."""

from __future__ import annotations

from dataclasses import dataclass

FORCE = "force"
"""Picture of a part that is about the load cell's reading: its plot."""

STOP_PARTS = (STOP, SUPPLY) = "stop", "supply"
"""Parts for which a person presses the emergency stop."""


@dataclass(frozen=True, slots=True)
class PartStatus:
    """One part: ``state`` open|right|wrong, and what its last check expected and found.

    ``picture``: as in the step. ``remedy``: what ``rig.toml`` can say
    instead of mending, empty for nothing.
    """

    name: str = ""
    title: str = ""
    picture: str = ""
    state: str = "open"
    expected: str = ""
    found: str = ""
    problem: str = ""
    remedy: str = ""


@dataclass(frozen=True, slots=True)
class SetupStatus:
    """The parts in their order, empty before a client has opened the setup.

    ``checking``: the part that is checked now, empty for none. ``question``: what a person does or
    looks at, empty while nothing is asked, with its ``question_id`` from 1; they answer one of
    ``choices``, or a number in ``unit``. ``known``: the answer of a simulated bench. ``remarks``:
    parts that must be checked again, one sentence each. ``picture``: as in the question.
    """

    parts: tuple[PartStatus, ...] = ()
    checking: str = ""
    question_id: int = 0
    question: str = ""
    choices: tuple[str, ...] = ()
    unit: str = ""
    known: str = ""
    remarks: tuple[str, ...] = ()
    picture: str = ""
