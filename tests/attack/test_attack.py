"""No write of a computer and no wrong wire makes the drum press too hard, move without a heartbeat,
or leave a pressed emergency stop; on virtual boards, and the worst attacks on the chip.

``make attack`` runs more attacks, with another seed each time; figures and seed are at the end of
the output.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from itertools import chain, islice
from pathlib import Path

import pytest

from rigctl.wire.drum.states import State
from tests.attack.attacker import run_attack
from tests.attack.benches import STIFF, VirtualBench
from tests.attack.chips import ChipBench
from tests.attack.statistics import AttackStatistics, run_attacks
from tests.attack.steps import (
    STATES,
    WIRES,
    Attack,
    grid_attacks,
    random_attack,
    wire_attack,
)
from tests.firmware.building import host_library

SEED = int(os.environ.get("RIGCTL_ATTACK_SEED", "1"))
RANDOM_ATTACKS = int(os.environ.get("RIGCTL_ATTACKS", "5000"))
CHIP_ATTACKS = int(os.environ.get("RIGCTL_CHIP_ATTACKS", "200"))
WIRE_ATTACKS = int(os.environ.get("RIGCTL_WIRE_ATTACKS", str(len(STATES) * len(WIRES))))
WORST_SHARE = 0.3
CONTROL_SEED, CONTROL_ATTACKS = 1, 5000

CONTROLS = (
    ("no-raw-limit", "force", 0),
    ("unguarded", "guard", 0),
    ("any-scale", "bounds", 0),
    ("short-lift", "lift", 0),
    ("both-ends-believed", "lift", 2287),
    ("tare-in-contact", "tare", 0),
    ("estop-configurable", "stop", 0),
    ("deaf", "heartbeat", 0),
)
"""A firmware without a rule (``BROKEN``), the judge's rule that detects it, and the first attack
to try.

Without the guard or with any scale no force gets too high, because the limit in raw counts
remains; and a tare in contact leads to no approach. The judge detects these by their direct effect:
a guarded setting that changed at the wrong time, an accepted value out of bounds, an accepted tare
during contact."""

WIRE_CONTROLS = (("any-direction", 1171), ("pressing-lift", 1806), ("loose-cell", 221))
"""A firmware without a rule about wires, and the first attack to try."""

RecordProperty = Callable[[str, object], None]


def attacks(count: int) -> Iterator[Attack]:
    """Yield the first random attacks of the seed."""
    return (random_attack(SEED, number) for number in range(count))


@pytest.fixture(scope="module")
def virtual() -> AttackStatistics:
    """Run the whole grid and the random attacks on virtual boards."""
    worst_count = max(1, round(WORST_SHARE * CHIP_ATTACKS))
    return run_attacks(VirtualBench, chain(grid_attacks(), attacks(RANDOM_ATTACKS)), worst_count)


def test_no_attack_on_a_virtual_board_succeeds(
    virtual: AttackStatistics, record_property: RecordProperty
) -> None:
    record_property("shown", f"virtual boards, seed {SEED}: {virtual}")
    assert not virtual.broken, virtual.summary()
    assert virtual.worst[0].peak_g > 0.8 * virtual.limit_g, "the attacks do not press"


def test_every_state_was_attacked(virtual: AttackStatistics) -> None:
    """After a reset a board is in SELFTEST before a write can reach it."""
    least = virtual.count // len(STATES) - 1
    began = {state: virtual.began[state] for state in STATES if state is not State.BOOT}
    assert min(began.values()) >= least, began
    assert began[State.SELFTEST] >= 2 * least


def test_no_attack_on_the_chip_succeeds(
    virtual: AttackStatistics, record_property: RecordProperty
) -> None:
    worst = [outcome.attack for outcome in virtual.worst]
    chosen = list(islice(chain(worst, attacks(CHIP_ATTACKS)), CHIP_ATTACKS))
    statistics = run_attacks(ChipBench, chosen)
    record_property("shown", f"chips, the {len(worst)} worst among them: {statistics}")
    assert not statistics.broken, statistics.summary()
    assert statistics.worst[0].peak_g > 0.8 * statistics.limit_g, "the attacks do not press"


@pytest.mark.parametrize(("broken", "rule", "first"), CONTROLS)
def test_a_firmware_without_a_rule_is_detected(
    broken: str, rule: str, first: int, tmp_path: Path, record_property: RecordProperty
) -> None:
    library = host_library("drum", broken, tmp_path / f"{broken}.so")
    for number in chain(range(first, CONTROL_ATTACKS), range(first)):
        outcome = run_attack(VirtualBench(library), random_attack(CONTROL_SEED, number))
        if rule in outcome.broken:
            record_property("shown", f"{broken}, attack {number}: {outcome.broken[rule]}")
            return
    pytest.fail(f"{CONTROL_ATTACKS} attacks of seed {CONTROL_SEED} do not notice {broken}")


def stiff_bench(library: Path | None = None) -> VirtualBench:
    """Return a virtual board on the stiffest contact."""
    return VirtualBench(library, STIFF)


@pytest.fixture(scope="module")
def wired() -> AttackStatistics:
    """Run the attacks on wires on virtual boards."""
    numbered = (wire_attack(SEED, number) for number in range(WIRE_ATTACKS))
    return run_attacks(stiff_bench, numbered)


def test_no_wrong_wire_on_a_virtual_board_presses_too_hard(
    wired: AttackStatistics, record_property: RecordProperty
) -> None:
    record_property("shown", f"wires, virtual boards, seed {SEED}: {wired}")
    record_property("shown", wired.by_wiring())
    assert not wired.broken, wired.summary()


def test_every_wiring_was_wrong_in_every_state(wired: AttackStatistics) -> None:
    pairs = {(state, name) for state in STATES for name in WIRES}
    assert len(pairs & wired.wired.keys()) >= min(len(pairs), WIRE_ATTACKS)


@pytest.mark.parametrize(("broken", "first"), WIRE_CONTROLS)
def test_a_firmware_without_a_rule_about_wires_is_detected(
    broken: str, first: int, tmp_path: Path, record_property: RecordProperty
) -> None:
    library = host_library("drum", broken, tmp_path / f"{broken}.so")
    for number in chain(range(first, CONTROL_ATTACKS), range(first)):
        outcome = run_attack(stiff_bench(library), wire_attack(CONTROL_SEED, number))
        if "force" in outcome.broken:
            record_property("shown", f"{broken}, attack {number}: {outcome.broken['force']}")
            return
    pytest.fail(f"{CONTROL_ATTACKS} attacks of seed {CONTROL_SEED} do not notice {broken}")
