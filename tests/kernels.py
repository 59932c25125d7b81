"""Compile the kernels that most tests run, before the workers of ``make test`` all do so."""

from __future__ import annotations

from tests.attack.attacker import run_attack
from tests.attack.benches import VirtualBench
from tests.attack.steps import random_attack
from tests.encoder.other_registers import digest

if __name__ == "__main__":
    run_attack(VirtualBench(), random_attack(1, 0))
    digest()
