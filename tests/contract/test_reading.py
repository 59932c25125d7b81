"""Replies of both kinds of boards: identity, settings, refusals, streams."""

from __future__ import annotations

import asyncio

import numpy as np
import pytest

from rigctl.bench.parameters import WorldParameters
from rigctl.bench.world_file import SimulatedWorld
from rigctl.boards import drum_registers
from rigctl.boards.drum_codes import Command, Status
from rigctl.boards.drum_registers import BY_NAME
from rigctl.boards.drum_states import State
from rigctl.boards.modbus_client import RequestRefused
from rigctl.boards.taxel_frames import WIRE_VERSION
from rigctl.config.rig_config import RigConfig, TaxelArray
from rigctl.errors import CommandRefused
from rigctl.rig import FIRMWARE, VIRTUAL, open_rig
from rigctl.values import DRAWN_WIRING, Block
from tests.contract.operator import Operator

UNTOUCHED = ("heartbeat", "command", "command_sequence")
SELF_TEST_S = 2.0
"""An amplifier settles for 0.4 s before the 40 samples that the drum judges, and may be slow."""


def test_the_drum_reports_its_identity(operator: Operator) -> None:
    identity = operator.drum.identity
    assert (identity.board, identity.wire_version) == ("drum", drum_registers.MAP_VERSION)
    assert identity.details == {"ring_depth": 64, "steps_per_turn": 12800, "nm_per_step": 31250}
    assert identity.boot_count >= 1
    assert identity.reset_cause & 1


def test_the_taxel_board_reports_its_identity(operator: Operator) -> None:
    identity = operator.taxels.identity
    assert (identity.board, identity.wire_version) == ("taxels", WIRE_VERSION)
    assert identity.details == {"rate_hz": 1000, "slots": 20, "slot_cycles": 800}
    assert identity.boot_count >= 1


def test_the_taxel_board_tests_itself_at_boot_and_on_request(operator: Operator) -> None:
    at_boot = operator.taxels.self_test
    assert at_boot is not None and at_boot.passed and at_boot.count == 1
    assert operator.taxels.status is not None
    assert abs(operator.taxels.status.supply_mv - 5000) < 30
    again = operator.run(operator.taxels.test())
    assert again.passed and again.count == 2
    assert operator.taxels.findings == []


def test_the_drum_boots_to_idle_with_the_defaults_of_the_table(operator: Operator) -> None:
    settings = operator.drum.settings
    operator.run(operator.until_state(State.IDLE, limit_s=SELF_TEST_S))
    assert settings == pytest.approx(
        {
            e.name: settings[e.name] if e.name in UNTOUCHED else e.default * e.scale
            for e in drum_registers.SETTINGS
        }
    )


def test_settings_are_read_back(operator: Operator) -> None:
    wanted = {
        "speed_set": 60.0,
        "force_set": 250.0,
        "travel_set": 120.0,
        "move_target": -70000.0,
        "clock_trim_ppm": -321.0,
        "scale_ug_per_count": -2400.0,
        "gain_p": 3.5,
    }

    async def main() -> dict[str, float]:
        before = dict(operator.drum.settings)
        assert await operator.drum.set(**wanted) == pytest.approx(wanted)
        seen = await operator.drum.get(*wanted)
        await operator.drum.set(**{name: before[name] for name in wanted})
        return seen

    assert operator.run(main()) == pytest.approx(wanted)


def words_out_of_range() -> list[tuple[str, int]]:
    """Return a word just out of bounds for every bounded 16-bit setting."""
    out = []
    for entry in drum_registers.SETTINGS:
        most = 32767 if entry.kind == "i16" else 65535
        if entry.words == 1 and entry.high < most:
            out.append((entry.name, entry.high + 1))
    return out


@pytest.mark.parametrize(("name", "word"), words_out_of_range())
async def test_one_value_out_of_range_is_refused_and_nothing_changes(
    operator: Operator, name: str, word: int
) -> None:
    before = await operator.drum.modbus.read(*drum_registers.SETTINGS_BLOCK)
    with pytest.raises(RequestRefused, match="a value is out of range") as refusal:
        await operator.drum.modbus.write(BY_NAME[name].address, (word,))
    assert refusal.value.code == 3
    assert await operator.drum.modbus.read(*drum_registers.SETTINGS_BLOCK) == before


async def test_one_value_out_of_range_refuses_all_values(operator: Operator) -> None:
    before = await operator.drum.modbus.read(*drum_registers.SETTINGS_BLOCK)
    address = BY_NAME["speed_set"].address
    with pytest.raises(RequestRefused) as refusal:
        await operator.drum.modbus.write(address, (6000, 2500, 1))
    assert refusal.value.code == 3
    assert await operator.drum.modbus.read(*drum_registers.SETTINGS_BLOCK) == before


@pytest.mark.parametrize("address", [0, 16, 115, 116, 141, 160, 415, 416, 60000])
async def test_writes_of_read_only_addresses_are_refused(operator: Operator, address: int) -> None:
    with pytest.raises(RequestRefused, match="no such register") as refusal:
        await operator.drum.modbus.write(address, (1,))
    assert refusal.value.code == 2


async def test_unused_addresses_read_as_zero_and_those_beyond_the_end_fail(
    operator: Operator,
) -> None:
    assert await operator.drum.modbus.read(14, 2) == [0, 0]
    assert await operator.drum.modbus.read(115, 1) == [0]
    assert await operator.drum.modbus.read(141, 19) == [0] * 19
    assert len(await operator.drum.modbus.read(drum_registers.END - 2, 2)) == 2
    for address, count in ((drum_registers.END, 1), (drum_registers.END - 1, 2)):
        with pytest.raises(RequestRefused) as refusal:
            await operator.drum.modbus.read(address, count)
        assert refusal.value.code == 2


@pytest.mark.parametrize(
    "command",
    [Command.MOVE, Command.APPROACH, Command.RUN, Command.RETRACT, Command.CLEAR, Command.HOME],
)
async def test_a_command_not_allowed_in_idle_is_refused(
    operator: Operator, command: Command
) -> None:
    await operator.poll()
    before = operator.states[-1]
    with pytest.raises(CommandRefused, match=f"refused {command.name} in state IDLE"):
        await operator.drum.command(command)
    after = await operator.poll()
    assert (after.state, after.fault) == (State.IDLE, 0)
    assert after.values["command_acknowledged"] == before.values["command_acknowledged"]


async def test_a_command_with_a_repeated_sequence_is_executed_once(operator: Operator) -> None:
    sequence = operator.drum._next_sequence()
    for _ in range(2):
        await operator.drum.modbus.write(BY_NAME["command"].address, (Command.ARM, sequence))
    await operator.until_state(State.ARMED)
    await operator.drum.modbus.write(BY_NAME["command"].address, (Command.ARM, sequence))
    assert (await operator.poll()).state == State.ARMED
    await operator.do(Command.DISARM)


async def test_an_idle_rig_has_no_force_and_no_fault(operator: Operator) -> None:
    state = await operator.poll()
    assert state.status_bits >> Status.ESTOP_CLOSED & 1
    assert not state.status_bits >> Status.SYNC_HIGH & 1
    assert (state.speed_mm_s, state.actuator_drive_permille, state.fault_bits) == (0.0, 0, 0)


def test_frames_arrive_at_the_boards_1000_hz_without_loss(operator: Operator) -> None:
    seconds = 5.0
    truth_ppm = operator.clocks_ppm["taxels"]

    async def main() -> tuple[int, float, int, float]:
        await operator.watch(0.1)
        first, first_s = int(operator.blocks[-1].counters[-1]), operator.blocks[-1].arrived_s
        await operator.watch(seconds)
        return first, first_s, int(operator.blocks[-1].counters[-1]), operator.blocks[-1].arrived_s

    operator.clear_record()
    first, first_s, last, last_s = operator.run(main())
    expected = (last_s - first_s) * 1000 * (1 + truth_ppm * 1e-6)
    assert abs(last - first - expected) < 2
    np.testing.assert_array_equal(np.diff(operator.counters), 1)
    counters = operator.taxels.counters
    assert (counters.lost, counters.gaps, counters.rejected_frames) == (0, 0, 0)
    status = operator.taxels.status
    assert status is not None
    assert (status.frames_dropped, status.late_slots) == (0, 0)
    assert abs(status.sample_counter - last) <= 100


async def test_every_load_cell_sample_arrives_once_at_slow_polls_too(operator: Operator) -> None:
    operator.clear_record()
    for pause_s in (0.02, 0.04, 0.1, 0.3, 0.7, 0.04, 0.6):
        await operator.poll()
        await asyncio.sleep(pause_s)
    await operator.poll()
    heard = [sample for state in operator.states for sample in state.loadcell]
    numbers = [sample.sequence for sample in heard]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    assert operator.states[-1].loadcell_lost == 0
    periods_us = np.diff([sample.board_time_us for sample in heard])
    assert abs(periods_us.mean() - 12_500) < 250
    assert periods_us.min() > 9_000


async def test_the_boards_clock_has_the_error_of_its_resonator(operator: Operator) -> None:
    operator.clear_record()
    await operator.watch(4.0)
    first, last = operator.states[0], operator.states[-1]
    ppm = ((last.board_time_us - first.board_time_us) / (last.at_s - first.at_s) / 1e6 - 1) * 1e6
    assert abs(ppm - operator.clocks_ppm["drum"]) < 400


BOTTOM = (3, 4, 5, 9, 10, 11, 15, 16, 17)
"""Readings of inputs A3 to A5, which the drawing leads to the bottom layer."""
ROW = (6, 7, 8, 9, 10, 11)
"""Readings of line 2, the second row of both layers."""
NOISE_COUNTS = 3
"""A dead taxel reads no more than the converter's own noise."""


@pytest.mark.parametrize("kind", [VIRTUAL, FIRMWARE])
@pytest.mark.parametrize(
    ("dead", "places"), [(BOTTOM, range(9, 18)), (ROW, (3, 4, 5, 12, 13, 14)), ((13,), (7,))]
)
def test_dead_readings_are_dead_places(
    kind: str, dead: tuple[int, ...], places: tuple[int, ...], request: pytest.FixtureRequest
) -> None:
    if kind == FIRMWARE:
        request.getfixturevalue("images")
    rig = open_rig(kind, paced=False, world=SimulatedWorld(WorldParameters(dead_taxels=dead)))
    asyncio.set_event_loop(rig.loop)
    blocks: list[Block] = []
    rig.taxels.on_block(blocks.append)

    async def listen() -> None:
        await rig.taxels.connect()
        await asyncio.sleep(0.2)

    try:
        rig.loop.run_until_complete(listen())
    finally:
        asyncio.set_event_loop(None)
        rig.close()
    samples = np.concatenate([block.samples for block in blocks])
    assert len(samples) > 100
    silent = np.flatnonzero(samples.mean(axis=0) < NOISE_COUNTS)
    assert silent.tolist() == sorted(places) == sorted(map(DRAWN_WIRING.index, dead))


WIRING = tuple(range(17, -1, -1))


@pytest.mark.parametrize("kind", [VIRTUAL, FIRMWARE])
def test_dead_taxels_are_named_by_their_place(kind: str, request: pytest.FixtureRequest) -> None:
    if kind == FIRMWARE:
        request.getfixturevalue("images")
    rig = open_rig(
        kind,
        paced=False,
        config=RigConfig(taxels=TaxelArray(wiring=WIRING)),
        world=SimulatedWorld(WorldParameters(dead_taxels=(2, 9))),
    )
    asyncio.set_event_loop(rig.loop)
    try:
        rig.loop.run_until_complete(rig.taxels.connect())
        assert rig.taxels.findings == [
            "taxel 16 (line D4, input A2) does not conduct: it is open or torn",
            "taxel 9 (line D5, input A3) does not conduct: it is open or torn",
        ]
    finally:
        asyncio.set_event_loop(None)
        rig.close()
