"""No wrong wire makes the drum press too hard, move without a heartbeat, or leave a pressed
emergency stop; on virtual boards, and the worst attacks on the chip. Before a board is
commissioned, no two wrong wires together make it press with more than 300 g.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from itertools import chain, combinations, islice
from pathlib import Path

import numpy as np
import pytest

from rigctl.bench.parameters import WorldParameters
from rigctl.boards.drum_codes import Command, Signal
from rigctl.boards.drum_registers import BY_NAME
from rigctl.boards.drum_states import State
from tests.attack.attacker import run_attack
from tests.attack.benches import BALANCED, CLOSE, STIFF, VirtualBench
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
    WHEN,
    WIRES,
    Action,
    ActionKind,
    Attack,
    Rewire,
    Step,
    pair_attack,
    restart_attacks,
    send,
    wait,
    wire_attack,
    write,
)
from tests.firmware.building import host_library

WIRE_ATTACKS = int(os.environ.get("RIGCTL_WIRE_ATTACKS", str(len(STATES) * len(WIRES))))
CHIP_WIRE_ATTACKS = int(os.environ.get("RIGCTL_CHIP_WIRE_ATTACKS", "10"))
PAIRS = int(os.environ.get("RIGCTL_WIRE_PAIRS", "20"))
WORST_PAIRS = 20

WIRE_CONTROLS = (
    ("any-direction", "force", 1446),
    ("pressing-lift", "force", 1806),
    ("loose-cell", "force", 258),
    ("bottomless", "force", 213),
    ("forgetful", "force", 259),
    ("blind-push", "force", 4615),
    ("position-believed", "lift", 680),
)
"""A firmware without a rule about wires, the judge's rule, and the first attack to try.

What is believed of a broken potentiometer presses no harder, because the load cell forbids what
follows: a lift then ends in ARMED while the drum rests on the sensor."""

SETUP_CONTROLS = (
    ("unfelt", "cell inputs shorted", "cell inputs shorted"),
    ("quick-lift", "actuator swapped", "potentiometer reversed"),
    ("tries-again", "actuator swapped", "cell excitation open"),
)
"""A firmware without a rule for boards that are not commissioned, and the wirings that show it."""


def wired_bench(attack: Attack, library: Path | None = None) -> VirtualBench:
    """Return a virtual board on the stiffest contact."""
    return VirtualBench(library, BALANCED if attack.is_balanced else STIFF)


def wired_chip(attack: Attack) -> ChipBench:
    """Return a chip on the stiffest contact."""
    return ChipBench(parameters=BALANCED if attack.is_balanced else STIFF)


def wire_attacks(count: int) -> Iterator[Attack]:
    """Yield the first attacks on wires of the seed."""
    return (wire_attack(SEED, number) for number in range(count))


@pytest.fixture(scope="module")
def wired() -> AttackStatistics:
    """Run the attacks on wires on virtual boards."""
    worst_count = max(1, round(WORST_SHARE * CHIP_WIRE_ATTACKS))
    every = chain(restart_attacks(), wire_attacks(WIRE_ATTACKS))
    return run_attacks(wired_bench, every, worst_count)


def test_no_wrong_wire_on_a_virtual_board_presses_too_hard(
    wired: AttackStatistics, record_property: RecordProperty
) -> None:
    record_property("shown", f"wires, virtual boards, seed {SEED}: {wired}")
    record_property("shown", wired.by_wiring())
    assert not wired.broken, wired.summary()


def test_every_wiring_was_wrong_in_every_state(wired: AttackStatistics) -> None:
    pairs = {(state, name) for state in STATES for name in WIRES}
    assert len(pairs & wired.wired.keys()) >= min(len(pairs), WIRE_ATTACKS)


def test_no_wrong_wire_on_the_chip_presses_too_hard(
    wired: AttackStatistics, record_property: RecordProperty
) -> None:
    """The worst of the virtual boards, and others spread over all wirings."""
    worst = [outcome.attack for outcome in wired.worst]
    every = list(wire_attacks(WIRE_ATTACKS))
    spread = every[:: max(1, len(every) // CHIP_WIRE_ATTACKS)]
    chosen = list(islice(chain(worst, spread), CHIP_WIRE_ATTACKS))
    statistics = run_attacks(wired_chip, chosen)
    record_property("shown", f"wires, chips, the {len(worst)} worst among them: {statistics}")
    record_property("shown", statistics.by_wiring())
    assert not statistics.broken, statistics.summary()


@pytest.mark.parametrize(("broken", "rule", "first"), WIRE_CONTROLS)
def test_a_firmware_without_a_rule_about_wires_is_detected(
    broken: str, rule: str, first: int, tmp_path: Path, record_property: RecordProperty
) -> None:
    library = host_library("drum", broken, tmp_path / f"{broken}.so")
    shown = detect(broken, rule, first, lambda attack: wired_bench(attack, library), wire_attack)
    record_property("shown", shown)


def test_a_firmware_that_believes_the_upper_switch_alone_is_detected(
    tmp_path: Path, record_property: RecordProperty
) -> None:
    library = host_library("drum", "switch-alone", tmp_path / "switch-alone.so")
    outcomes = [run_attack(wired_bench(attack, library), attack) for attack in restart_attacks()]
    broken = {outcome.attack.wired: outcome.broken for outcome in outcomes if outcome.broken}
    record_property("shown", f"switch-alone: {broken}")
    assert "lift" in broken["upper end switch unplugged"]


def chosen_pairs() -> list[tuple[str, str]]:
    """Return pairs of wirings that the seed determines."""
    every = list(combinations(WIRES, 2))
    order = np.random.default_rng(SEED).permutation(len(every))[:PAIRS]
    return [every[i] for i in order]


def run_pairs(attacks: list[Attack], record_property: RecordProperty) -> list[AttackStatistics]:
    """Run attacks on boards that are not commissioned, with the drum at two distances."""
    found = []
    for place, world in (("10 mm", STIFF), ("0.1 mm", CLOSE)):

        def bench(_: Attack, world: WorldParameters = world) -> VirtualBench:
            return VirtualBench(parameters=world)

        found.append(run_attacks(bench, attacks, WORST_PAIRS))
        record_property("shown", f"{len(attacks)} setups, {place} above: {found[-1].table()}")
    return found


def test_no_wrong_wires_press_with_300_g_before_the_setup_has_passed(
    record_property: RecordProperty,
) -> None:
    """Each alone and any two: from power-up, once the drum is lifted, or while it presses."""
    alone = [pair_attack(name, name, when) for name in WIRES for when in WHEN]
    pairs = [pair_attack(*pair, when) for pair in chosen_pairs() for when in WHEN]
    for statistics in run_pairs([*alone, *pairs], record_property):
        assert not statistics.broken, statistics.summary()
        assert statistics.worst[0].peak_g > 150, "the attacks do not press"


def arming_without_potentiometer(cell: str, times: int = 4) -> Attack:
    """Return an attack that arms a board without a potentiometer, its actuator reversed.

    Nothing but the cell then shows which way the drum goes. Each fault is cleared and armed again.
    """
    fitted = BY_NAME["optional_signals"].default & ~(1 << Signal.POSITION)
    wrong = (Rewire("actuator swapped", True), Rewire(cell, True))
    arming: tuple[Step, ...] = (send(Command.ARM), wait(9000), send(Command.CLEAR), wait(20))
    unfitted = (write("optional_signals", fitted), wait(20))
    steps = (*wrong, Action(ActionKind.RESET), wait(300), *unfitted, *arming * times)
    return Attack(f"actuator swapped and {cell}", State.IDLE, steps, commissioned=False)


@pytest.mark.parametrize("cell", ["actuator swapped", "cell reversed", "cell half-bridge"])
def test_without_a_potentiometer_a_reversed_actuator_presses_with_less_than_300_g(
    cell: str, record_property: RecordProperty
) -> None:
    """Two reversed wires do not explain each other: what presses would read as what lifts."""
    (far, near) = run_pairs([arming_without_potentiometer(cell)], record_property)
    assert not far.broken and not near.broken, far.summary() + near.summary()
    assert far.worst[0].peak_g > 100, "the attack does not press"


def test_a_firmware_that_believes_a_lighter_drum_is_detected(tmp_path: Path) -> None:
    library = host_library("drum", "lighter-lifts", tmp_path / "lighter-lifts.so")
    attack = arming_without_potentiometer("cell reversed", times=1)
    assert run_attack(VirtualBench(library, STIFF), attack).peak_g > 10_000


@pytest.mark.parametrize(("broken", "first", "second"), SETUP_CONTROLS)
def test_a_firmware_without_a_rule_for_the_setup_is_detected(
    broken: str, first: str, second: str, tmp_path: Path
) -> None:
    library = host_library("drum", broken, tmp_path / f"{broken}.so")
    outcomes = (
        run_attack(VirtualBench(library, CLOSE), pair_attack(first, second, when)) for when in WHEN
    )
    assert any("force" in outcome.broken for outcome in outcomes)
