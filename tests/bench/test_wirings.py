"""Wrong wirings: each shows where the catalogue says, and none leaves a trace once it is off."""

from __future__ import annotations

import hashlib
import random
from collections.abc import Iterator
from dataclasses import fields

import numpy as np
import pytest

from rigctl.bench.circuit import AS_DRAWN, Circuit
from rigctl.bench.electrics import actuator_pins, constants, terminal_drive
from rigctl.bench.parameters import WorldParameters
from rigctl.bench.simulated_rig import SimulatedRig
from rigctl.bench.virtual_rig import VirtualRig, open_virtual_rig
from rigctl.bench.wirings import WIRINGS, circuit_of, find_wiring
from rigctl.boards.drum_codes import Command
from rigctl.boards.drum_registers import BY_NAME, POLL_BLOCK, UNIT, pack_value
from rigctl.errors import WrongUse
from tests.bench.host import framed

SEED = 5
NEAR = WorldParameters(contact_mm=10.0, actuator_start_mm=4.0, start_mm=190.0)
TRAVEL_MM = NEAR.actuator_travel_mm
ON_VIRTUAL = [w.name for w in WIRINGS.values() if w.reaches == "both builds"]
BY_A_PERSON = [w.name for w in WIRINGS.values() if w.reaches == "a person"]
REMEMBERED = {"E-stop normally open", "E-stop unplugged", "cell at 10 samples a second"}
"""A board latches an opened emergency stop; an amplifier goes on from where it is, to 1 µs."""
END_S = 11.0


def write(name: str, raw: int) -> bytes:
    words = pack_value(BY_NAME[name], raw)
    head = bytes([UNIT, 16, 0, BY_NAME[name].address, 0, len(words), 2 * len(words)])
    return framed(head + b"".join(word.to_bytes(2, "big") for word in words))


def command(number: int, code: Command) -> bytes:
    head = bytes([UNIT, 16, 0, 64, 0, 3, 6])
    return framed(head + b"".join(word.to_bytes(2, "big") for word in (number, code, number)))


def poll(beat: int) -> bytes:
    address, count = POLL_BLOCK
    words = (address, count, 64, 1)
    return framed(
        bytes([UNIT, 23])
        + b"".join(word.to_bytes(2, "big") for word in words)
        + bytes([2, beat >> 8, beat & 255])
    )


REQUESTS = {
    250: command(1, Command.COMMISSION),
    300: command(2, Command.ARM),
    1500: command(3, Command.TARE),
    2300: write("move_target", 7040),
    2350: command(4, Command.MOVE),
    5500: write("move_target", 6400),
    5550: command(5, Command.MOVE),
    6200: command(6, Command.APPROACH),
    9200: command(7, Command.RUN),
}
"""A host that arms, turns the drum past two places of the index and back, presses and runs."""
REQUESTS |= {at: poll(at // 50) for at in range(210, int(END_S * 1000), 50)}
ACTS = {
    (450, "hold_ends", (True, False)),
    (700, "hold_ends", (False, True)),
    (900, "hold_ends", ()),
    (10_600, "press_estop", ()),
}
"""What a person does meanwhile."""


def timeline() -> Iterator[tuple[int, str, tuple[object, ...]]]:
    yield from sorted(
        [*ACTS, *((at, "", (request,)) for at, request in REQUESTS.items())],
        key=lambda act: act[:2],
    )


def heard(rig: SimulatedRig) -> str:
    """Return a hash of all that the host hears in a session of fixed requests."""
    digest = hashlib.sha256()
    rig.drum.open(lambda data, at_s: digest.update(data), lambda why: None)
    taxels: list[bytes] = []
    rig.taxels.open(lambda data, at_s: taxels.append(data), lambda why: None)
    for at_ms, name, arguments in timeline():
        rig.advance(1000 * at_ms)
        if name:
            getattr(rig.faults, name)(*arguments)
        else:
            rig.drum.write(*arguments)  # type: ignore[arg-type]
    rig.advance(int(END_S * 1e6))
    digest.update(b"".join(taxels))
    rig.close()
    return digest.hexdigest()


def wired(*names: str) -> VirtualRig:
    rig = open_virtual_rig(NEAR, SEED)
    rig.set_plate("L")
    for name in names:
        rig.faults.wire(name)
    return rig


@pytest.fixture(scope="module")
def as_drawn() -> str:
    return heard(wired())


def test_the_catalogue_has_at_least_forty_wirings_whose_effects_are_of_the_circuit() -> None:
    names = {field.name for field in fields(Circuit)}
    assert len(WIRINGS) >= 40
    for wiring in WIRINGS.values():
        assert wiring.effects.keys() <= names
        assert circuit_of([wiring.name]) != AS_DRAWN, wiring.name


def test_a_group_has_two_wirings_or_more_unless_the_page_says_why() -> None:
    groups = [wiring.group for wiring in WIRINGS.values() if wiring.group]
    assert {group for group in groups if groups.count(group) < 2} <= {
        "the actuator does not press",
        "the index comes once in two commanded turns",
    }


@pytest.mark.parametrize("name", ON_VIRTUAL)
def test_the_host_of_a_virtual_rig_hears_each_wiring(name: str, as_drawn: str) -> None:
    assert heard(wired(name)) != as_drawn


@pytest.mark.parametrize("name", BY_A_PERSON)
def test_what_no_board_sees_a_meter_shows(name: str, as_drawn: str) -> None:
    rig, drawn = wired(name), wired()
    for each in (rig, drawn):
        each.faults.press_estop()
    assert rig.test_points != drawn.test_points
    for each in (rig, drawn):
        each.close()
    assert heard(wired(name)) == as_drawn


@pytest.mark.parametrize("name", [name for name in WIRINGS if name not in REMEMBERED])
def test_a_wiring_switched_on_and_off_leaves_the_bench_as_before(name: str, as_drawn: str) -> None:
    rig = wired(name)
    assert rig.faults.wirings == (name,)
    rig.faults.wire(name, False)
    assert rig.faults.wirings == ()
    assert heard(rig) == as_drawn


def test_wires_change_at_random_times_and_the_circuit_ends_as_drawn() -> None:
    rig, draw = wired(), random.Random(SEED)
    state = rig.cosimulation
    for _ in range(300):
        rig.faults.wire(draw.choice(list(WIRINGS)), draw.random() < 0.5)
        rig.advance(rig.time_us + draw.randrange(1, 20_000))
    for name in rig.faults.wirings:
        rig.faults.wire(name, False)
    rig.advance(rig.time_us + 200_000)
    np.testing.assert_array_equal(state.bench.electrics, constants(AS_DRAWN))
    io = state.firmware.io
    assert (io.direction, io.step_size, io.motor_jammed, io.mark_inverted) == (0, 1.0, 0, 0)
    assert state.bench.loadcell.period_us == wired().cosimulation.bench.loadcell.period_us
    rig.close()


def test_an_unknown_wiring_is_refused_with_those_that_are_near() -> None:
    with pytest.raises(WrongUse, match='"actuator swapped"') as refusal:
        find_wiring("acutator swaped")
    assert "\n" not in str(refusal.value)
    assert find_wiring("e-STOP  unplugged").name == "E-stop unplugged"
    assert find_wiring("E- not connected to ground").effects["cell_gain"] == 0.3


def reading(name: str, rod_mm: float) -> int:
    e = constants(circuit_of([name] if name else []))
    return int(actuator_pins(e, rod_mm, TRAVEL_MM)[0] * 1023 + 0.5)


def test_a_broken_wire_of_the_potentiometer_leaves_the_range_of_travel_everywhere() -> None:
    assert (reading("", 0.0), reading("", TRAVEL_MM)) == (44, 979)
    for rod_mm in np.linspace(0.0, TRAVEL_MM, 11):
        at = float(rod_mm)
        assert reading("potentiometer wiper open", at) == 0
        assert reading("potentiometer shorted to ground", at) == 0
        assert reading("potentiometer shorted to 5 V", at) == 1023
        assert reading("potentiometer 5 V end open", at) == 0
        assert reading("potentiometer ground end open", at) > 1000
        assert 300 < reading("potentiometer wiper open, no pull-down", at) < 450
    assert reading("potentiometer reversed", 0.0) == 979


@pytest.mark.parametrize(
    ("name", "press", "lift"),
    [
        ("actuator swapped", -0.5, 0.25),
        ("actuator supply half", 0.25, -0.125),
        ("actuator supply missing", 0.0, 0.0),
        ("bridge never presses", 0.0, -0.25),
        ("bridge never lifts", 0.5, 0.0),
    ],
)
def test_the_actuator_has_the_voltage_of_its_wires(name: str, press: float, lift: float) -> None:
    e = constants(circuit_of([name]))
    assert (terminal_drive(e, 0.5), terminal_drive(e, -0.25)) == (press, lift)


@pytest.mark.parametrize(
    ("name", "supply"), [("", 0.0), ("E-stop second contact not in the supply", 1.0)]
)
def test_the_stop_cuts_the_supplies_with_its_second_contact(name: str, supply: float) -> None:
    rig = wired(*([name] if name else []))
    assert rig.test_points.actuator_supply == rig.test_points.motor_supply == 1.0
    rig.faults.press_estop()
    assert rig.test_points.actuator_supply == rig.test_points.motor_supply == supply
    assert terminal_drive(rig.cosimulation.bench.electrics, 1.0) == supply
    rig.close()


def test_end_switches_follow_their_wires_and_a_hand() -> None:
    def levels(name: str, **held: object) -> tuple[bool, bool]:
        e = constants(circuit_of([name] if name else []), **held)  # type: ignore[arg-type]
        return actuator_pins(e, 0.0, TRAVEL_MM)[1:]

    assert levels("") == (True, False)
    assert levels("", held_ends=(False, True)) == (True, True)
    assert levels("end switches swapped") == (False, True)
    assert levels("end switches normally open") == (False, True)
    assert levels("lower end switch unplugged") == (True, True)
    assert levels("end switches bridged") == (False, False)
