"""What of a session is exported: trials, taxels, and what was made of the readings."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum

from rigctl.errors import WrongUse

MAX_NUMBER = 1_000_000_000


class Representation(StrEnum):
    """What stands for a trial: its readings, its spikes, or spikes counted in windows."""

    READINGS = "readings"
    SPIKES = "spikes"
    COUNTS = "counts"


USUAL = (Representation.READINGS, Representation.SPIKES)


@dataclass(frozen=True, slots=True)
class Selection:
    """Trials by their ids and taxels from 1, each empty for all of them."""

    trials: frozenset[int] = frozenset()
    taxels: frozenset[int] = frozenset()
    representations: tuple[Representation, ...] = USUAL

    @property
    def is_whole(self) -> bool:
        """Whether the samples between the trials belong to it, too."""
        return not self.trials


def parse_numbers(option: str, text: str) -> frozenset[int]:
    """Return the numbers of a list such as ``1-100,205``. Raises WrongUse for another text."""
    return frozenset(_numbers(option, text))


def _numbers(option: str, text: str) -> Iterable[int]:
    for piece in text.split(","):
        first, dash, last = (part.strip() for part in piece.partition("-"))
        low, high = first, last if dash else first
        digits = (low + high).isascii() and low.isdigit() and high.isdigit()
        if not digits or not 1 <= int(low) <= int(high) <= MAX_NUMBER:
            raise WrongUse(
                f"{option} {text[:40]}: give numbers from 1 and ranges of them, such as 1-100,205"
            )
        if int(high) - int(low) > 1_000_000:
            raise WrongUse(f"{option} {text[:40]}: a range has at most a million numbers")
        yield from range(int(low), int(high) + 1)


def parse_representations(option: str, text: str) -> tuple[Representation, ...]:
    """Return the representations of a list such as ``readings,spikes``. Raises WrongUse."""
    names = [name.strip() for name in text.split(",")]
    if unknown := [name for name in names if name not in list(Representation)]:
        raise WrongUse(
            f"{option} {unknown[0][:40]!r} is none of {', '.join(Representation)}: name some of "
            "them, with commas"
        )
    return tuple(one for one in Representation if one in names)
