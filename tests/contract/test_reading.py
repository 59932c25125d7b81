"""What both kinds of boards say when asked, what they accept, and what they refuse."""

from __future__ import annotations

import asyncio

import numpy as np
import pytest

from rigctl.devices.modbus_client import RequestRefused
from rigctl.errors import CommandRefused
from rigctl.wire.drum import register_table
from rigctl.wire.drum.codes import Command, Status
from rigctl.wire.drum.register_table import BY_NAME
from rigctl.wire.drum.states import State
from rigctl.wire.taxels.frames import WIRE_VERSION
from tests.contract.operator import Operator

UNTOUCHED = ("heartbeat", "command", "command_sequence")


def test_the_drum_says_who_it_is(at_rig: Operator) -> None:
    identity = at_rig.drum.identity
    assert (identity.board, identity.wire_version) == ("drum", register_table.MAP_VERSION)
    assert identity.details == {"ring_depth": 64, "steps_per_turn": 12800, "nm_per_step": 31250}
    assert identity.boot_count >= 1
    assert identity.reset_cause & 1


def test_the_taxel_board_says_who_it_is(at_rig: Operator) -> None:
    identity = at_rig.taxels.identity
    assert (identity.board, identity.wire_version) == ("taxels", WIRE_VERSION)
    assert identity.details == {"rate_hz": 1000, "slots": 20, "slot_cycles": 800}
    assert identity.boot_count >= 1


def test_the_taxel_board_tests_itself_at_boot_and_on_request(at_rig: Operator) -> None:
    at_boot = at_rig.taxels.self_test
    assert at_boot is not None and at_boot.passed and at_boot.count == 1
    assert at_rig.taxels.status is not None
    assert abs(at_rig.taxels.status.supply_mv - 5000) < 30
    again = at_rig.run(at_rig.taxels.test())
    assert again.passed and again.count == 2
    assert at_rig.taxels.findings == []


def test_the_drum_boots_to_idle_with_the_tables_defaults(at_rig: Operator) -> None:
    settings = at_rig.drum.settings
    assert at_rig.state is State.IDLE
    assert settings == pytest.approx(
        {
            e.name: settings[e.name] if e.name in UNTOUCHED else e.default * e.scale
            for e in register_table.SETTINGS
        }
    )


def test_settings_are_read_back_as_they_were_set(at_rig: Operator) -> None:
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
        before = dict(at_rig.drum.settings)
        assert await at_rig.drum.set(**wanted) == pytest.approx(wanted)
        seen = await at_rig.drum.get(*wanted)
        await at_rig.drum.set(**{name: before[name] for name in wanted})
        return seen

    assert at_rig.run(main()) == pytest.approx(wanted)


def words_out_of_range() -> list[tuple[str, int]]:
    """For every bounded 16-bit setting a word just outside."""
    out = []
    for entry in register_table.SETTINGS:
        most = 32767 if entry.kind == "i16" else 65535
        if entry.words == 1 and entry.high < most:
            out.append((entry.name, entry.high + 1))
    return out


@pytest.mark.parametrize(("name", "word"), words_out_of_range())
def test_one_value_out_of_range_is_refused_and_nothing_changes(
    at_rig: Operator, name: str, word: int
) -> None:
    async def main() -> None:
        before = await at_rig.drum.modbus.read(*register_table.SETTINGS_BLOCK)
        with pytest.raises(RequestRefused, match="a value is out of range") as refusal:
            await at_rig.drum.modbus.write(BY_NAME[name].address, (word,))
        assert refusal.value.code == 3
        assert await at_rig.drum.modbus.read(*register_table.SETTINGS_BLOCK) == before

    at_rig.run(main())


def test_of_several_values_none_is_taken_when_one_is_out_of_range(at_rig: Operator) -> None:
    async def main() -> None:
        before = await at_rig.drum.modbus.read(*register_table.SETTINGS_BLOCK)
        address = BY_NAME["speed_set"].address
        with pytest.raises(RequestRefused) as refusal:
            await at_rig.drum.modbus.write(address, (6000, 2500, 1))
        assert refusal.value.code == 3
        assert await at_rig.drum.modbus.read(*register_table.SETTINGS_BLOCK) == before

    at_rig.run(main())


@pytest.mark.parametrize("address", [0, 16, 113, 116, 127, 128, 383, 384, 60000])
def test_what_cannot_be_written_is_refused_as_no_address(at_rig: Operator, address: int) -> None:
    async def main() -> None:
        with pytest.raises(RequestRefused, match="no such register") as refusal:
            await at_rig.drum.modbus.write(address, (1,))
        assert refusal.value.code == 2

    at_rig.run(main())


def test_holes_read_as_zero_and_the_end_is_the_end(at_rig: Operator) -> None:
    async def main() -> None:
        assert await at_rig.drum.modbus.read(14, 2) == [0, 0]
        assert await at_rig.drum.modbus.read(113, 2) == [0, 0]
        assert len(await at_rig.drum.modbus.read(register_table.END - 2, 2)) == 2
        for address, count in ((register_table.END, 1), (register_table.END - 1, 2)):
            with pytest.raises(RequestRefused) as refusal:
                await at_rig.drum.modbus.read(address, count)
            assert refusal.value.code == 2

    at_rig.run(main())


@pytest.mark.parametrize(
    "command",
    [Command.MOVE, Command.APPROACH, Command.RUN, Command.RETRACT, Command.CLEAR, Command.HOME],
)
def test_a_command_that_idle_does_not_allow_is_refused(at_rig: Operator, command: Command) -> None:
    async def main() -> None:
        await at_rig.drum.poll()
        before = at_rig.states[-1]
        with pytest.raises(CommandRefused, match=f"refused {command.name} in state IDLE"):
            await at_rig.drum.command(command)
        after = await at_rig.drum.poll()
        assert (after.state, after.fault) == (State.IDLE, 0)
        assert after.values["command_acknowledged"] == before.values["command_acknowledged"]

    at_rig.run(main())


def test_a_repeated_command_with_the_same_sequence_is_executed_once(at_rig: Operator) -> None:
    async def main() -> None:
        sequence = at_rig.drum._next_sequence()
        for _ in range(2):
            await at_rig.drum.modbus.write(BY_NAME["command"].address, (Command.ARM, sequence))
        await at_rig.until_state(State.ARMED)
        await at_rig.drum.modbus.write(BY_NAME["command"].address, (Command.ARM, sequence))
        assert (await at_rig.drum.poll()).state == State.ARMED
        await at_rig.do(Command.DISARM)

    at_rig.run(main())


def test_an_idle_rig_shows_an_unpressed_unfaulted_bench(at_rig: Operator) -> None:
    async def main() -> None:
        state = await at_rig.drum.poll()
        assert state.status_bits >> Status.ESTOP_CLOSED & 1
        assert not state.status_bits >> Status.SYNC_HIGH & 1
        assert (state.speed_mm_s, state.actuator_drive_permille, state.fault_bits) == (0.0, 0, 0)

    at_rig.run(main())


def test_frames_come_at_the_boards_own_thousand_hertz_and_none_is_lost(at_rig: Operator) -> None:
    seconds = 5.0
    truth_ppm = at_rig.clocks_ppm["taxels"]

    async def main() -> tuple[int, float, int, float]:
        await at_rig.watch(0.1)
        first, first_s = int(at_rig.blocks[-1].counters[-1]), at_rig.blocks[-1].arrived_s
        await at_rig.watch(seconds)
        return first, first_s, int(at_rig.blocks[-1].counters[-1]), at_rig.blocks[-1].arrived_s

    at_rig.forget()
    first, first_s, last, last_s = at_rig.run(main())
    expected = (last_s - first_s) * 1000 * (1 + truth_ppm * 1e-6)
    assert abs(last - first - expected) < 2
    np.testing.assert_array_equal(np.diff(at_rig.counters), 1)
    counters = at_rig.taxels.counters
    assert (counters.lost, counters.gaps, counters.rejected_frames) == (0, 0, 0)
    status = at_rig.taxels.status
    assert status is not None
    assert (status.frames_dropped, status.late_slots) == (0, 0)
    assert abs(status.sample_counter - last) <= 100


def test_every_load_cell_sample_is_heard_once_at_slow_polls_too(at_rig: Operator) -> None:
    async def main() -> None:
        at_rig.forget()
        for pause_s in (0.02, 0.04, 0.1, 0.3, 0.7, 0.04, 0.6):
            await at_rig.drum.poll()
            await asyncio.sleep(pause_s)
        await at_rig.drum.poll()

    at_rig.run(main())
    heard = [sample for state in at_rig.states for sample in state.loadcell]
    numbers = [sample.sequence for sample in heard]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    assert at_rig.states[-1].loadcell_lost == 0
    periods_us = np.diff([sample.board_time_us for sample in heard])
    assert abs(periods_us.mean() - 12_500) < 250
    assert periods_us.min() > 9_000


def test_the_boards_clock_runs_as_fast_as_its_resonator(at_rig: Operator) -> None:
    async def main() -> None:
        at_rig.forget()
        await at_rig.watch(4.0)

    at_rig.run(main())
    first, last = at_rig.states[0], at_rig.states[-1]
    ppm = ((last.board_time_us - first.board_time_us) / (last.at_s - first.at_s) / 1e6 - 1) * 1e6
    assert abs(ppm - at_rig.clocks_ppm["drum"]) < 400
