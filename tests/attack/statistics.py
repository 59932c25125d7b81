"""Run many attacks and collect their number, the worst ones and the successful ones."""

from __future__ import annotations

import heapq
import os
from collections import Counter
from collections.abc import Callable, Iterable
from itertools import chain

import pytest

from rigctl.boards.drum_states import State
from tests.attack.attacker import Outcome, run_attack
from tests.attack.benches import AttackBench
from tests.attack.steps import Attack

SEED = int(os.environ.get("RIGCTL_ATTACK_SEED", "1"))
CONTROL_SEED, CONTROL_ATTACKS = 1, 5000
WORST_SHARE = 0.3
"""Of the attacks on the chip: those that were the worst on virtual boards."""
SHOWN = 10
RecordProperty = Callable[[str, object], None]


class AttackStatistics:
    """Statistics of attacks. ``worst`` is sorted by force, the highest first.

    Forces that no firmware can bound count as 0.
    """

    def __init__(self, worst_count: int) -> None:
        self.began: Counter[State] = Counter()
        self.wired: Counter[tuple[State, str]] = Counter()
        self.highest_g: dict[str, float] = {}
        self.broken: list[Outcome] = []
        self.limit_g = 0.0
        self._worst_count = worst_count
        self._worst: list[tuple[float, int, Outcome]] = []

    @property
    def count(self) -> int:
        """Number of attacks."""
        return self.began.total()

    @property
    def worst(self) -> list[Outcome]:
        """The attacks with the highest forces."""
        return [outcome for *_, outcome in sorted(self._worst, reverse=True)]

    def add(self, outcome: Outcome) -> None:
        """Add an outcome."""
        self.began[outcome.began] += 1
        self.limit_g = outcome.limit_g
        peak_g = 0.0 if outcome.was_unbounded else outcome.peak_g
        wired = outcome.attack.wired
        self.wired[outcome.attack.state, wired] += 1
        self.highest_g[wired] = max(self.highest_g.get(wired, 0.0), peak_g)
        heapq.heappush(self._worst, (peak_g, self.count, outcome))
        if len(self._worst) > self._worst_count:
            heapq.heappop(self._worst)
        if outcome.broken:
            self.broken.append(outcome)

    def __str__(self) -> str:
        worst = self.worst[0]
        return (
            f"{self.count} attacks, {len(self.broken)} succeeded; "
            f"highest {worst.peak_g:.0f} g of {self.limit_g:.0f} g: {worst.attack}"
        )

    def by_wiring(self) -> str:
        """Return the number of attacks and the highest force with each wiring, by force."""
        states = len({state for state, _ in self.wired})
        attacks = Counter(wired for _, wired in self.wired.elements())
        ranked = sorted(self.highest_g, key=self.highest_g.__getitem__, reverse=True)
        rows = (f"{wired}: {attacks[wired]}, {self.highest_g[wired]:.0f} g" for wired in ranked)
        return f"{len(attacks)} wirings in {states} states: {'; '.join(rows)}"

    def table(self) -> str:
        """Return the worst attacks with their forces, the highest first."""
        return "; ".join(f"{w.attack.name}: {w.peak_g:.0f} g" for w in self.worst)

    def summary(self) -> str:
        """Return the first successful attacks, one per line."""
        return "\n".join(map(str, self.broken[:SHOWN]))


def run_attacks(
    bench: Callable[[Attack], AttackBench], attacks: Iterable[Attack], worst_count: int = 1
) -> AttackStatistics:
    """Run each attack on a new bench."""
    statistics = AttackStatistics(worst_count)
    for attack in attacks:
        statistics.add(run_attack(bench(attack), attack))
    return statistics


def detect(
    broken: str,
    rule: str,
    first: int,
    benches: Callable[[Attack], AttackBench],
    attacks: Callable[[int, int], Attack],
) -> str:
    """Return which attack shows that a broken firmware violates a rule, the likely one first.

    ``attacks`` returns the attack of a seed and number. Fails the test where none shows it.
    """
    for number in chain(range(first, CONTROL_ATTACKS), range(first)):
        attack = attacks(CONTROL_SEED, number)
        outcome = run_attack(benches(attack), attack)
        if rule in outcome.broken:
            return f"{broken}, attack {number}: {outcome.broken[rule]}"
    pytest.fail(f"{CONTROL_ATTACKS} attacks of seed {CONTROL_SEED} do not notice {broken}")
