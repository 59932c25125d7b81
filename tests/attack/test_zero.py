"""No write moves a limit: the board determines the zero of its force itself."""

from __future__ import annotations

import pytest

from rigctl.boards.drum_codes import Command, CommandResult, ForceMode, Signal
from rigctl.boards.drum_registers import BY_NAME, TARE_PLACES
from rigctl.boards.drum_states import State
from tests.attack.attacker import ARM, HOLD, Attacker
from tests.attack.benches import VirtualBench
from tests.attack.steps import (
    Action,
    ActionKind,
    Rewire,
    Write,
    send,
    wait,
    wait_until_idle,
    write,
)

DEEP = (
    *ARM,
    send(Command.HOME),
    wait_until_idle(9000),
    write("force_mode", ForceMode.POSITION),
    write("depth_set_um", 10_000),
    write("over_force", 30_000),
)
RESULT = BY_NAME["command_result"].address
HARD = (write("over_force", 30_000), write("force_set", 15_000))


def peak_g(place_counts: int) -> float:
    """Return the true force of the deepest approach right after a tare with such a table.

    It must follow immediately, because the board tares a resting drum again.
    """
    bench = VirtualBench()
    attacker = Attacker(bench)
    table = Write(BY_NAME["tare_place_00"].address, (place_counts & 0xFFFF,) * TARE_PLACES)
    attacker.run_steps((*DEEP, table, send(Command.TARE)))
    while bench.read(RESULT, 1)[0] == CommandResult.RUNNING:
        attacker.run_steps((wait(1),))
    attacker.run_steps((send(Command.APPROACH), wait_until_idle(9000)))
    assert bench.state is State.FAULT_LIFT
    bench.close()
    return attacker.judge.peak_g


@pytest.mark.parametrize("place_counts", [-32_768, 32_767])
def test_tares_of_places_do_not_move_the_limit(place_counts: int) -> None:
    """The table alone would shift the limit by 79 g either way."""
    assert peak_g(place_counts) == pytest.approx(peak_g(0), abs=20)


def test_inverted_end_switches_do_not_fake_a_lift() -> None:
    """With inverted end switches, a board that boots in contact would arm immediately and tare
    while it presses; repeated approaches would then exceed every limit."""
    bench = VirtualBench()
    attacker = Attacker(bench)
    wires = 1 << Signal.END_SWITCHES
    saved = (write("signal_polarity", wires), send(Command.SAVE), wait(600))
    pressed = (*HARD, send(Command.TARE), wait(800), send(Command.APPROACH))
    lifted = (send(Command.DISARM), send(Command.ARM), wait_until_idle(2000))
    sound = (write("signal_polarity", 0), *lifted, *pressed, wait_until_idle(6000))
    attacker.run_steps((*ARM, *saved, *sound))
    assert bench.plant.force_g > 1400
    stopped = (Action(ActionKind.ESTOP, 1), wait(20), Action(ActionKind.RESET), wait(20))
    attacker.run_steps((*stopped, Action(ActionKind.ESTOP, 0), wait(200), send(Command.CLEAR)))
    assert bench.read(BY_NAME["signal_polarity"].address, 1) == [wires]
    assert bench.plant.force_g > 1400
    attacker.run_steps((send(Command.ARM), wait_until_idle(8000)))
    assert bench.state is State.ARMED
    assert bench.plant.force_g == 0
    bench.close()


@pytest.mark.parametrize("has_position", [True, False])
def test_an_open_upper_switch_does_not_fake_a_lift_after_a_restart(has_position: bool) -> None:
    """The force of the contact would become the zero, and each later one would add to it."""
    bench = VirtualBench()
    attacker = Attacker(bench)
    restarted = (Rewire("upper end switch unplugged", True), Action(ActionKind.RESET), wait(300))
    attacker.run_steps((*HOLD, *restarted))
    held_g = bench.plant.force_g
    assert held_g > 400
    if not has_position:
        attacker.run_steps((write("optional_signals", 31 & ~(1 << Signal.POSITION)),))
    press = (send(Command.TARE), wait(800), send(Command.APPROACH), wait_until_idle(9000))
    attacker.run_steps((send(Command.COMMISSION), send(Command.ARM), wait(9000), *press))
    assert bench.state is (State.FAULT_OFF if has_position else State.HOLD)
    assert attacker.judge.peak_g < 1.2 * held_g
    assert "lift" not in attacker.judge.broken
    bench.close()
