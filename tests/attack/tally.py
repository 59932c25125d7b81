"""Carries out many attacks and keeps what matters: how many, the worst, and what did not stand."""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Callable, Iterable

from rigctl.wire.drum.states import State
from tests.attack.attacker import Outcome, attacked
from tests.attack.benches import AttackBench
from tests.attack.steps import Attack

SHOWN = 10


class Tally:
    """What came of attacks. ``worst`` is ordered by force, the highest first."""

    def __init__(self, keep: int) -> None:
        self.began: Counter[State] = Counter()
        self.broken: list[Outcome] = []
        self.limit_g = 0.0
        self._keep = keep
        self._worst: list[tuple[float, int, Outcome]] = []

    @property
    def count(self) -> int:
        """Attacks carried out."""
        return self.began.total()

    @property
    def worst(self) -> list[Outcome]:
        """The attacks that came nearest to the limit."""
        return [outcome for *_, outcome in sorted(self._worst, reverse=True)]

    def add(self, outcome: Outcome) -> None:
        """Count one in."""
        self.began[outcome.began] += 1
        self.limit_g = outcome.limit_g
        heapq.heappush(self._worst, (outcome.peak_g, self.count, outcome))
        if len(self._worst) > self._keep:
            heapq.heappop(self._worst)
        if outcome.broken:
            self.broken.append(outcome)

    def __str__(self) -> str:
        worst = self.worst[0]
        return (
            f"{self.count} attacks, {len(self.broken)} succeeded; "
            f"highest {worst.peak_g:.0f} g of {self.limit_g:.0f} g: {worst.attack}"
        )

    def told(self) -> str:
        """The first that succeeded, a line each."""
        return "\n".join(map(str, self.broken[:SHOWN]))


def carried_out(
    bench: Callable[[], AttackBench], attacks: Iterable[Attack], keep: int = 1
) -> Tally:
    """Attack a bench that is new each time."""
    tally = Tally(keep)
    for attack in attacks:
        tally.add(attacked(bench(), attack))
    return tally
