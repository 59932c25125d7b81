"""No write of a computer makes the drum press too hard, move without a heartbeat, or leave a
pressed emergency stop; on virtual boards, and the worst attacks on the chip.

``make attack`` runs more attacks, with another seed each time; figures and seed are at the end of
the output.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from itertools import chain, islice
from pathlib import Path

import pytest

from rigctl.boards.drum_states import State
from tests.attack.benches import VirtualBench
from tests.attack.chips import ChipBench
from tests.attack.statistics import (
    SEED,
    WORST_SHARE,
    AttackStatistics,
    RecordProperty,
    detect,
    run_attacks,
)
from tests.attack.steps import (
    STATES,
    Attack,
    grid_attacks,
    random_attack,
)
from tests.firmware.building import host_library

RANDOM_ATTACKS = int(os.environ.get("RIGCTL_ATTACKS", "600"))
CHIP_ATTACKS = int(os.environ.get("RIGCTL_CHIP_ATTACKS", "20"))

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


def attacks(count: int) -> Iterator[Attack]:
    """Yield the first random attacks of the seed."""
    return (random_attack(SEED, number) for number in range(count))


@pytest.fixture(scope="module")
def virtual() -> AttackStatistics:
    """Run the whole grid and the random attacks on virtual boards."""
    worst_count = max(1, round(WORST_SHARE * CHIP_ATTACKS))
    every = chain(grid_attacks(), attacks(RANDOM_ATTACKS))
    return run_attacks(lambda _: VirtualBench(), every, worst_count)


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
    statistics = run_attacks(lambda _: ChipBench(), chosen)
    record_property("shown", f"chips, the {len(worst)} worst among them: {statistics}")
    assert not statistics.broken, statistics.summary()
    assert statistics.worst[0].peak_g > 0.8 * statistics.limit_g, "the attacks do not press"


@pytest.mark.parametrize(("broken", "rule", "first"), CONTROLS)
def test_a_firmware_without_a_rule_is_detected(
    broken: str, rule: str, first: int, tmp_path: Path, record_property: RecordProperty
) -> None:
    library = host_library("drum", broken, tmp_path / f"{broken}.so")
    shown = detect(broken, rule, first, lambda _: VirtualBench(library), random_attack)
    record_property("shown", shown)
