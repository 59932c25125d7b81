"""Nothing that a computer does to the drum board presses too hard, moves it unheard, or frees it
from an emergency stop that is held; on virtual boards, and the worst of it on the chip.

``make attack`` does the same for longer, with another seed each time; the figures and the seed
stand at the end of the output.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from itertools import chain, islice
from pathlib import Path

import pytest

from rigctl.host_build import build
from rigctl.wire.drum.states import State
from tests.attack.attacker import attacked
from tests.attack.benches import VirtualBench
from tests.attack.chips import ChipBench
from tests.attack.steps import STATES, Attack, drawn, grid
from tests.attack.tally import Tally, carried_out

SEED = int(os.environ.get("RIGCTL_ATTACK_SEED", "1"))
DRAWN = int(os.environ.get("RIGCTL_ATTACKS", "5000"))
ON_CHIPS = int(os.environ.get("RIGCTL_CHIP_ATTACKS", "200"))
WORST_SHARE = 0.3
CONTROL_SEED, CONTROL_ATTACKS = 1, 5000

CONTROLS = (
    ("NO_RAW_LIMIT", "force", 0),
    ("NO_GUARD", "guard", 0),
    ("ANY_SCALE", "bounds", 0),
    ("SHORT_LIFT", "lift", 0),
    ("BOTH_ENDS_BELIEVED", "lift", 2287),
    ("TARE_IN_CONTACT", "tare", 0),
    ("ESTOP_CONFIGURABLE", "stop", 0),
    ("HEARTBEAT_IGNORED", "heartbeat", 0),
)
"""A firmware without a rule, the judge's rule by which it is caught, and the attack to begin with.

Without the guard or with any scale no force gets too high, since the limit in raw counts stands
behind them; and a tare in contact leads to no approach. These are judged by what they promise: a
guarded setting that changed where it must not, a value out of bounds that was taken, a tare that
was taken while the bench felt contact."""

Show = Callable[[str, object], None]


def attacks(count: int) -> Iterator[Attack]:
    """So many attacks of the seed."""
    return (drawn(SEED, number) for number in range(count))


@pytest.fixture(scope="module")
def virtual() -> Tally:
    """The whole grid and what is drawn, on virtual boards."""
    keep = max(1, round(WORST_SHARE * ON_CHIPS))
    return carried_out(VirtualBench, chain(grid(), attacks(DRAWN)), keep)


def test_no_attack_on_a_virtual_board_succeeds(virtual: Tally, record_property: Show) -> None:
    record_property("shown", f"virtual boards, seed {SEED}: {virtual}")
    assert not virtual.broken, virtual.told()
    assert virtual.worst[0].peak_g > 0.8 * virtual.limit_g, "the attacks do not press"


def test_every_state_was_attacked(virtual: Tally) -> None:
    """A board that has just been reset is in SELFTEST before anybody can write."""
    least = virtual.count // len(STATES) - 1
    begun = {state: virtual.began[state] for state in STATES if state is not State.BOOT}
    assert min(begun.values()) >= least, begun
    assert begun[State.SELFTEST] >= 2 * least


def test_no_attack_on_the_chip_succeeds(virtual: Tally, record_property: Show) -> None:
    worst = [outcome.attack for outcome in virtual.worst]
    chosen = list(islice(chain(worst, attacks(ON_CHIPS)), ON_CHIPS))
    tally = carried_out(ChipBench, chosen)
    record_property("shown", f"chips, the {len(worst)} worst among them: {tally}")
    assert not tally.broken, tally.told()
    assert tally.worst[0].peak_g > 0.8 * tally.limit_g, "the attacks do not press"


@pytest.mark.parametrize(("define", "rule", "first"), CONTROLS)
def test_a_firmware_without_the_rule_is_caught(
    define: str, rule: str, first: int, tmp_path: Path, record_property: Show
) -> None:
    library = build("drum", tmp_path / f"{define}.so", [define])
    for number in chain(range(first, CONTROL_ATTACKS), range(first)):
        outcome = attacked(VirtualBench(library), drawn(CONTROL_SEED, number))
        if rule in outcome.broken:
            record_property("shown", f"{define}, attack {number}: {outcome.broken[rule]}")
            return
    pytest.fail(f"{CONTROL_ATTACKS} attacks of seed {CONTROL_SEED} do not notice {define}")
