"""What is written moves no limit: the zero from which the board judges force is its own."""

from __future__ import annotations

import pytest

from rigctl.wire.drum.codes import Command, CommandResult, ForceMode, Signal
from rigctl.wire.drum.register_table import BY_NAME, TARE_PLACES
from rigctl.wire.drum.states import State
from tests.attack.attacker import ARM, Attacker
from tests.attack.benches import VirtualBench
from tests.attack.steps import Act, What, Write, give, write

DEEP = (
    *ARM,
    give(Command.HOME),
    Act(What.REST, 9000),
    write("force_mode", ForceMode.POSITION),
    write("depth_set_um", 10_000),
    write("over_force", 30_000),
)
RESULT = BY_NAME["command_result"].address
HARD = (write("over_force", 30_000), write("force_set", 15_000))


def peak_g(place_counts: int) -> float:
    """True force of an approach as deep as can be, right after a tare with such a table.

    Right after it: a drum that rests is weighed anew.
    """
    bench = VirtualBench()
    attacker = Attacker(bench)
    table = Write(BY_NAME["tare_place_00"].address, (place_counts & 0xFFFF,) * TARE_PLACES)
    attacker.carry_on((*DEEP, table, give(Command.TARE)))
    while bench.read(RESULT, 1)[0] == CommandResult.RUNNING:
        attacker.carry_on((Act(What.WAIT, 1),))
    attacker.carry_on((give(Command.APPROACH), Act(What.REST, 9000)))
    assert bench.state is State.FAULT_LIFT
    bench.close()
    return attacker.judge.peak_g


@pytest.mark.parametrize("place_counts", [-32_768, 32_767])
def test_tares_of_places_do_not_move_the_limit(place_counts: int) -> None:
    """By the table alone it would be 79 g either way."""
    assert peak_g(place_counts) == pytest.approx(peak_g(0), abs=20)


def test_end_switches_told_the_other_way_lift_no_drum() -> None:
    """Saved so, and booted in contact: armed at once, the drum would be weighed while it presses,
    and whoever approaches it a thousand times creeps past every limit."""
    bench = VirtualBench()
    attacker = Attacker(bench)
    wires = 1 << Signal.END_SWITCHES
    saved = (write("signal_polarity", wires), give(Command.SAVE), Act(What.WAIT, 600))
    pressed = (*HARD, give(Command.TARE), Act(What.WAIT, 800), give(Command.APPROACH))
    lifted = (give(Command.DISARM), give(Command.ARM), Act(What.REST, 2000))
    sound = (write("signal_polarity", 0), *lifted, *pressed, Act(What.REST, 6000))
    attacker.carry_on((*ARM, *saved, *sound))
    assert bench.plant.force_g > 1400
    stopped = (Act(What.ESTOP, 1), Act(What.WAIT, 20), Act(What.RESET), Act(What.WAIT, 20))
    attacker.carry_on((*stopped, Act(What.ESTOP, 0), Act(What.WAIT, 200), give(Command.CLEAR)))
    assert bench.read(BY_NAME["signal_polarity"].address, 1) == [wires]
    assert bench.plant.force_g > 1400
    attacker.carry_on((give(Command.ARM), Act(What.REST, 2000)))
    assert bench.state is State.ARMED
    assert bench.plant.force_g == 0
    bench.close()
