"""What a step of the setup asks a person, and what it has found."""

from __future__ import annotations

import math
from typing import NamedTuple

from rigctl.config.toml_edit import Value
from rigctl.config.typed_number import typed_number
from rigctl.errors import WrongUse

DONE, YES, NO = "done", "yes", "no"
YES_OR_NO = (YES, NO)


class Question(NamedTuple):
    """What a person does or looks at, and how they answer.

    ``key`` names the act for a simulated bench, which does it itself. ``choices``: the answers;
    empty where a number is asked for, in ``unit`` from ``low`` to ``high``. ``picture``:
    what it is about, where that is another part of the drawing than that of the step.
    """

    key: str
    text: str
    choices: tuple[str, ...] = (DONE,)
    unit: str = ""
    low: float = 0.0
    high: float = 0.0
    picture: str = ""

    def checked(self, answer: str) -> str:
        """Return the answer as it is used. Raises WrongUse for one that is not possible."""
        given = answer.strip().lower()
        if not self.choices:
            return f"{self._number(given):g}"
        if self.choices == (DONE,):
            return DONE
        chosen = [choice for choice in self.choices if choice.startswith(given)] if given else []
        if len(chosen) != 1:
            raise WrongUse(f"answer {', '.join(self.choices[:-1])} or {self.choices[-1]}")
        return chosen[0]

    def _number(self, given: str) -> float:
        try:
            value = float(typed_number(given.removesuffix(self.unit.lower())))
        except WrongUse:
            value = math.nan
        if not self.low <= value <= self.high:
            raise WrongUse(
                f"answer with a number from {self.low:g} to {self.high:g} {self.unit}, "
                "without marks between its thousands"
            )
        return value


class Remedy(NamedTuple):
    """Keys of a table of ``rig.toml`` that describe a part as it is wired; ``text`` says so."""

    table: str
    keys: dict[str, Value]
    text: str


class CheckResult(NamedTuple):
    """What a step has found beside what it expected, both in words.

    ``problem``: what a wrong reading means and what to do, one sentence, empty where the part is
    right. ``causes``: the wrong wirings that read like this, by their names in
    ``docs/reference/wrong-wirings.md``; more than one where no sensor tells them apart.
    ``remedy``: how ``rig.toml`` can describe the part instead; None where it must be mended.
    """

    expected: str
    found: str
    problem: str = ""
    causes: tuple[str, ...] = ()
    remedy: Remedy | None = None

    @property
    def passed(self) -> bool:
        """Whether the part is right."""
        return not self.problem
