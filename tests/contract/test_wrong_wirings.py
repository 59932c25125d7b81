"""Wrong wirings have the same effects at the pins of virtual boards and of simulated chips."""

from __future__ import annotations

import asyncio
import random
import re
from collections import defaultdict
from collections.abc import Coroutine
from typing import Any

import numpy as np
import pytest

from rigctl.bench.chips.simavr import Input
from rigctl.bench.wirings import WIRINGS
from rigctl.boards.drum_codes import Command
from rigctl.boards.drum_states import Fault, State
from rigctl.errors import CommandRefused, RigctlError, WrongUse
from rigctl.rig import FIRMWARE, VIRTUAL, open_rig
from tests.contract.operator import NOMINAL, Operator

SEED = 5
KINDS = [VIRTUAL, FIRMWARE]
START_MM = NOMINAL.actuator_start_mm
OFFSET = NOMINAL.loadcell_offset_counts
MOVE_STEPS = 640.0
REST = NOMINAL.rest_conductance


@pytest.fixture(params=KINDS)
def kind(request: pytest.FixtureRequest) -> str:
    if request.param == FIRMWARE:
        request.getfixturevalue("images")
    return str(request.param)


def on_rig(kind: str, names: tuple[str, ...], work: Any) -> Any:
    """Return what ``work(operator)`` returns on a rig with these wirings."""
    rig = open_rig(kind, seed=SEED, paced=False, wirings=names)
    asyncio.set_event_loop(rig.loop)
    try:
        assert rig.wirings == names
        at = Operator(rig)
        coroutine: Coroutine[Any, Any, Any] = work(at)
        return at.run(coroutine)
    finally:
        asyncio.set_event_loop(None)
        rig.close()


async def cell(at: Operator) -> tuple[float, float, Fault]:
    """Return mean counts and conversions a second of half a second, and the fault."""
    await at.drum.connect()
    await at.watch(0.3)
    at.states.clear()
    await at.watch(1.0)
    samples = {s.board_time_us: s.raw_counts for state in at.states for s in state.loadcell}
    times = np.array(sorted(samples))
    rate = 1e6 * (times.size - 1) / (times[-1] - times[0]) if times.size > 1 else 0.0
    return float(np.mean(list(samples.values()) or [0])), float(rate), at.fault


@pytest.mark.parametrize(
    ("name", "counts", "rate_hz", "fault"),
    [
        ("cell reversed", -OFFSET, 80.6, Fault.NONE),
        ("amplifier at gain 64", OFFSET / 2, 80.6, Fault.NONE),
        ("cell excitation open", 3100, 80.6, Fault.NONE),
        ("cell at 10 samples a second", OFFSET, 10.08, None),
        ("cell data unplugged", None, 0.0, None),
        ("cell clock unplugged", 0, None, Fault.LOADCELL_DESYNC),
    ],
)
def test_the_load_cell(
    kind: str, name: str, counts: float | None, rate_hz: float | None, fault: Fault | None
) -> None:
    found_counts, found_hz, found_fault = on_rig(kind, (name,), cell)
    print(name, found_counts, found_hz, found_fault)
    assert counts is None or abs(found_counts - counts) < 1500
    assert rate_hz is None or found_hz == pytest.approx(rate_hz, rel=0.01)
    assert fault is None or found_fault is fault


async def arm_refusal(at: Operator) -> str:
    """Return why the drum does not arm once it has measured the amplifier's rate."""
    await at.drum.connect()
    await at.watch(2.5)
    with pytest.raises(CommandRefused) as refused:
        await at.drum.command(Command.ARM)
    return str(refused.value)


def test_a_cell_at_another_rate_than_that_of_rig_toml_is_not_armed(kind: str) -> None:
    sentence = on_rig(kind, ("cell at 10 samples a second",), arm_refusal)
    assert re.search(
        r"the drum refused ARM in state IDLE: 10\.?\d? samples a second: the load cell's amplifier "
        r"does not sample at the rate of rig\.toml: connect its RATE pin to its supply for 80 "
        r"samples a second, or set rate_hz = 10 in \[loadcell\]$",
        sentence,
    ), sentence


async def position_mm(at: Operator) -> float:
    await at.drum.connect()
    await at.watch(0.3)
    return at.states[-1].actuator_position_um * 1e-3


@pytest.mark.parametrize(
    ("name", "shown_mm"),
    [
        ("potentiometer reversed", 50.0 - START_MM),
        ("potentiometer wiper open", 0.0),
        ("potentiometer shorted to 5 V", 50.0),
        ("potentiometer ground end open", 50.0),
    ],
)
def test_the_potentiometer(kind: str, name: str, shown_mm: float) -> None:
    assert on_rig(kind, (name,), position_mm) == pytest.approx(shown_mm, abs=0.15)


async def moved_mm(at: Operator) -> tuple[float, float]:
    """Return how far the drum really turned, commanded forwards and then back."""
    await at.connect()
    await at.reach(State.ARMED)
    moved = []
    for target in (MOVE_STEPS, 0.0):
        at.simulation.truth.take()
        await at.drum.set(move_target=target)
        await at.do(Command.MOVE)
        moved.append(float(at.simulation.truth.take().speed_mm_s.sum() * 1e-3))
    return moved[0], moved[1]


@pytest.mark.parametrize(
    ("name", "forwards", "back"),
    [
        ("direction reversed", -1.0, 1.0),
        ("stepper coil reversed", -1.0, 1.0),
        ("direction stuck", 1.0, 1.0),
        ("stepper coils crossed", 0.0, 0.0),
        ("8 microsteps", 2.0, -2.0),
        ("belt 3:1", 4 / 3, -4 / 3),
        ("drum of 360 mm", 0.9, -0.9),
    ],
)
def test_the_drum_turns_as_driver_and_motor_are_connected(
    kind: str, name: str, forwards: float, back: float
) -> None:
    nominal_mm = MOVE_STEPS * NOMINAL.mm_per_step
    moved = on_rig(kind, (name,), moved_mm)
    assert np.array(moved) / nominal_mm == pytest.approx([forwards, back], abs=0.01)


async def at_rest(at: Operator) -> tuple[Any, float]:
    """Return the mean readings of the sensor at rest, by place, and the board's supply."""
    await at.taxels.connect()
    await asyncio.sleep(0.3)
    status = at.taxels.status
    assert status is not None
    return at.samples.mean(axis=0), status.supply_mv * 1e-3


@pytest.mark.parametrize(
    ("name", "dead"),
    [("taxel line open", (3, 4, 5, 12, 13, 14)), ("taxel input open", (2, 5, 8))],
)
def test_an_open_wire_of_the_sensor_silences_its_places(
    kind: str, name: str, dead: tuple[int, ...]
) -> None:
    readings, _ = on_rig(kind, (name,), at_rest)
    assert np.flatnonzero(readings < 3).tolist() == list(dead)


def test_a_missing_divider_leaves_its_input_to_the_taxels(kind: str) -> None:
    readings, _ = on_rig(kind, ("taxel divider missing",), at_rest)
    assert np.flatnonzero(readings > 100).tolist() == [10, 13, 16]


def test_the_uno_reports_a_low_supply(kind: str) -> None:
    readings, supply_v = on_rig(kind, ("supply at 4.4 V",), at_rest)
    assert supply_v == pytest.approx(4.4, abs=0.03)
    drawn, nominal_v = on_rig(kind, (), at_rest)
    assert nominal_v == pytest.approx(5.0, abs=0.03)
    np.testing.assert_allclose(readings, drawn, atol=0.2)


async def connected(at: Operator) -> tuple[bool, bool]:
    outcome = []
    for board in (at.drum, at.taxels):
        try:
            await board.connect()
            outcome.append(True)
        except RigctlError:
            outcome.append(False)
    return outcome[0], outcome[1]


def test_boards_answer_at_the_ports_where_they_are(kind: str) -> None:
    assert on_rig(kind, (), connected) == (True, True)
    assert on_rig(kind, ("boards swapped",), connected) == (False, False)
    assert on_rig(kind, ("two boards of one kind",), connected) == (True, False)


def test_a_rig_with_a_wrong_wiring_starts_not_commissioned(kind: str) -> None:
    for names in ((), ("cell half-bridge",)):
        rig = open_rig(kind, seed=SEED, paced=False, wirings=names)
        assert rig.commissions is not bool(names)
        rig.close()


async def shaken(at: Operator) -> tuple[float, float, float]:
    """Change wires at random times, then wire as drawn; return counts, rate and position."""
    draw, names = random.Random(SEED), list(WIRINGS)
    for _ in range(150):
        at.faults.wire(draw.choice(names), draw.random() < 0.6)
        await asyncio.sleep(draw.uniform(0.0003, 0.02))
    for name in at.rig.wirings:
        at.faults.wire(name, False)
    await asyncio.sleep(0.5)
    counts, rate_hz, _ = await cell(at)
    return counts, rate_hz, at.states[-1].actuator_position_um * 1e-3


def test_a_bench_whose_wires_were_changed_at_random_times_is_whole_again(kind: str) -> None:
    counts, rate_hz, shown_mm = on_rig(kind, (), shaken)
    assert counts == pytest.approx(OFFSET, abs=1500)
    assert rate_hz == pytest.approx(80.6, rel=0.01)
    assert shown_mm == pytest.approx(START_MM, abs=0.15)


async def spikes(at: Operator) -> dict[Input, list[int]]:
    """Return the lengths of the spikes at each pin in half a second, in cycles."""
    chip, changes = at.simulation.drum_board.chip, defaultdict(list)
    put = chip.set_input

    def record(signal: Input, cycle: int, level: int) -> None:
        changes[signal].append(cycle)
        put(signal, cycle, level)

    chip.set_input = record
    await asyncio.sleep(0.5)
    return {signal: np.diff(cycles)[::2].tolist() for signal, cycles in changes.items()}


def test_noise_on_switches_is_spikes_at_the_pins_of_a_chip(images: object) -> None:
    lengths = on_rig(FIRMWARE, ("noise on switches",), spikes)
    assert lengths.keys() == {Input.ESTOP, Input.END_UP, Input.END_DOWN}
    for each in lengths.values():
        assert len(each) == 10
        assert np.array(each) == pytest.approx(80, abs=1)
    assert on_rig(FIRMWARE, (), spikes) == {}


def test_a_wiring_of_a_real_rig_and_an_unknown_one_are_refused(tmp_path: Any) -> None:
    with pytest.raises(WrongUse, match='"E-stop unplugged"'):
        open_rig(VIRTUAL, wirings=["E-stop unpluged"])
    rig_file = tmp_path / "rig.toml"
    rig_file.write_text("")
    with pytest.raises(WrongUse, match="leave --wire out"):
        open_rig(str(rig_file), wirings=["E-stop unplugged"])
