"""The drum's driver with boards that reply late, wrongly, or not at all."""

from __future__ import annotations

import asyncio
import random

import pytest

from rigctl.boards.drum import Drum, command_refusal_text
from rigctl.boards.drum_codes import Command, Status
from rigctl.boards.drum_registers import BY_NAME
from rigctl.boards.drum_states import Fault, State
from rigctl.errors import BoardRebooted, CommandRefused, LinkLost, WrongBoard, WrongUse
from tests.boards.memory_link import (
    JumpingLoop,
    LoadCellBoard,
    MemoryLink,
    Script,
    rtu,
    unconnected_drum,
)


async def test_connect_returns_the_identity_and_reads_the_settings(loop: JumpingLoop) -> None:
    drum, board, _ = unconnected_drum(loop)
    board.put("force_set", 2500)
    identity = await drum.connect()
    assert (identity.board, identity.firmware_version) == ("drum", "1.3")
    assert (identity.build_hash, identity.boot_count) == ("00c0ffee", 41)
    assert identity.details["nm_per_step"] == 31250
    assert drum.settings["force_set"] == 250.0
    assert not drum.rebooted
    drum.close()


async def test_every_byte_of_a_connect_a_setting_and_a_command(loop: JumpingLoop) -> None:
    link = MemoryLink(loop)
    identity = "5247 0005 0001 0100 0000 0001 0007 0001 0040 3200 0000 7a12 07d0 01ef"
    settings = "0000 0000 0009" + 48 * " 0000"
    script = Script(
        link,
        [
            (
                rtu(bytes.fromhex("03 0000 000e")),
                rtu(bytes.fromhex("031c" + identity)),
            ),
            (
                rtu(bytes.fromhex("03 0040 0033")),
                rtu(bytes.fromhex("0366" + settings)),
            ),
            (
                rtu(bytes.fromhex("17 0044 0002 0044 0002 04 1f40 1388")),
                rtu(bytes.fromhex("17 04 1f40 1388")),
            ),
            (
                rtu(bytes.fromhex("10 0041 0002 04 0001 000a")),
                rtu(bytes.fromhex("10 0041 0002")),
            ),
        ],
    )
    drum = Drum(link, loop)
    await drum.connect()
    assert await drum.set(speed_set=80, force_set=500) == {
        "speed_set": 80.0,
        "force_set": 500.0,
    }
    await drum.command(Command.ARM)
    assert script.left == []
    drum.close()


async def test_connect_waits_for_a_board_that_boots_slowly(loop: JumpingLoop) -> None:
    drum, board, _ = unconnected_drum(loop)
    board.silent = True
    loop.call_later(1.8, setattr, board, "silent", False)
    await drum.connect()
    assert 1.8 < loop.time() < 2.2
    drum.close()


@pytest.mark.parametrize(
    ("register", "value", "sentence"),
    [
        ("magic", 0, "not a drum board"),
        ("board_id", 2, "not a drum board"),
        ("map_version", 9, "register map 9, this program map .*`rigctl flash drum`"),
    ],
)
async def test_another_device_is_named(
    loop: JumpingLoop, register: str, value: int, sentence: str
) -> None:
    drum, board, link = unconnected_drum(loop)
    board.put(register, value)
    with pytest.raises(WrongBoard, match=sentence):
        await drum.connect()
    assert not link.is_open


async def test_nobody_there_is_said_in_time(loop: JumpingLoop) -> None:
    drum, board, link = unconnected_drum(loop)
    board.silent = True
    with pytest.raises(LinkLost, match="no drum board answered within 4 s"):
        await drum.connect()
    assert loop.time() < 5
    link.plugged = False
    with pytest.raises(LinkLost, match="no such port"):
        await drum.connect()


async def test_a_stream_of_foreign_bytes_is_refused(loop: JumpingLoop) -> None:
    drum, _, link = unconnected_drum(loop)
    link.board = lambda data: link.say(bytes(range(40)))
    with pytest.raises(WrongBoard, match="bytes came, but no complete reply from a drum board"):
        await drum.connect()


async def test_a_request_with_a_lost_or_damaged_reply_is_repeated(loop: JumpingLoop) -> None:
    drum, board, _ = unconnected_drum(loop)
    await drum.connect()
    board.garble = 2
    state = await drum.poll()
    assert state.values["heartbeat_seen"] == 1
    assert drum.modbus.timeouts == 2
    drum.close()


async def test_silence_is_reported_within_0_3_s(loop: JumpingLoop) -> None:
    drum, board, link = unconnected_drum(loop)
    await drum.connect()
    await drum.poll()
    board.silent, fell_silent_s = True, loop.time()
    await asyncio.sleep(0.04)
    with pytest.raises(LinkLost, match=r"/dev/drum: no answer for 0\.24 s"):
        await drum.poll()
    assert loop.time() - fell_silent_s < 0.3
    board.silent = False
    await drum.connect()
    assert not drum.rebooted
    # Opening the port again would have reset a real board, which may be lifting just now.
    assert link.times_opened == 1
    drum.close()


async def test_an_unplug_ends_the_pending_exchange_immediately(loop: JumpingLoop) -> None:
    drum, board, link = unconnected_drum(loop)
    await drum.connect()
    loop.call_later(0.002, link.unplug)
    started_s = loop.time()
    with pytest.raises(LinkLost, match="the port vanished"):
        await drum.poll()
    assert loop.time() - started_s < 0.005
    with pytest.raises(LinkLost, match="the port vanished"):
        await drum.set(speed_set=80)
    link.plugged = True
    board.put("boot_count", 42)
    await drum.connect()
    assert drum.rebooted


async def test_out_of_bounds_never_reaches_the_wire_and_a_refusal_is_a_sentence(
    loop: JumpingLoop,
) -> None:
    drum, board, link = unconnected_drum(loop)
    await drum.connect()
    sent = len(link.written)
    with pytest.raises(WrongUse, match="speed_set cannot be 300 mm/s"):
        await drum.set(force_set=500, speed_set=300)
    assert len(link.written) == sent
    board.refuse = 3
    with pytest.raises(CommandRefused, match="a value is out of range: force_set not set"):
        await drum.set(force_set=500)
    board.refuse = 4
    board.put("state", State.FAULT_OFF)
    board.put("fault", Fault.ESTOP)
    with pytest.raises(CommandRefused, match=r"refused ARM in state FAULT_OFF \(emergency"):
        await drum.command(Command.ARM)
    drum.close()


@pytest.mark.parametrize("is_commissioned", [False, True])
def test_a_refused_clear_of_a_drum_that_did_not_lift_says_to_restart(is_commissioned: bool) -> None:
    status = 1 << Status.CONTACT_MAY_STAND | is_commissioned << Status.COMMISSIONED
    stuck = State.FAULT_OFF, Fault.ACTUATOR_STUCK, status
    assert ("restart the drum board" in command_refusal_text(Command.CLEAR, *stuck)) is (
        not is_commissioned
    )
    assert "restart" not in command_refusal_text(Command.ARM, *stuck)


async def test_a_tare_changes_the_zero_of_raw_counts(loop: JumpingLoop) -> None:
    drum, board, _ = unconnected_drum(loop)
    await drum.connect()
    board.put("loadcell_recent", 81_000)
    board.put("loadcell_sequence", 1)
    before = (await drum.poll()).loadcell[0].force_g
    board.put("tare_counts", 80_000)
    await drum.command(Command.TARE)
    await drum.poll()
    board.put("loadcell_sequence", 2)
    after = (await drum.poll()).loadcell[0].force_g
    assert before == pytest.approx(81_000 * 2400e-6)
    assert after == pytest.approx(1_000 * 2400e-6)
    drum.close()


async def test_a_gap_in_the_load_cell_is_read_from_the_ring(loop: JumpingLoop) -> None:
    drum, board, _ = unconnected_drum(loop)
    await drum.connect()
    board.put("loadcell_sequence", 65520)
    await drum.poll()
    start_us = round(loop.time() * 1e6)
    for n in range(65521, 65561):
        place = n % 64
        raw, at = (BY_NAME[name].address + 2 * place for name in ("ring_raw", "ring_time_us"))
        board.words[raw : raw + 2] = [0, n - 65500]
        at_us = start_us + (n - 65520) * 12_500
        board.words[at : at + 2] = [at_us >> 16, at_us & 0xFFFF]
    await asyncio.sleep(0.5)
    board.put("loadcell_sequence", 65560 % 65536)
    board.put("loadcell_time_us", start_us + 500_000)
    board.put("loadcell_recent", *(n - 65500 for n in range(65560, 65555, -1)))
    state = await drum.poll()
    assert [s.raw_counts for s in state.loadcell] == [n - 65500 for n in range(65521, 65561)]
    assert state.loadcell_lost == 0
    drum.close()


async def test_polls_of_two_tasks_share_the_samples_between_them(loop: JumpingLoop) -> None:
    link = MemoryLink(loop)
    LoadCellBoard(loop, link)
    drum = Drum(link, loop)
    await asyncio.sleep(1.0)
    await drum.connect()
    numbers: list[int] = []
    for _ in range(10):
        for state in await asyncio.gather(drum.poll(), drum.poll(), drum.poll()):
            numbers += [sample.sequence for sample in state.loadcell]
        await asyncio.sleep(0.5)
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    drum.close()


async def test_two_minutes_of_polls_with_stalls_lose_no_load_cell_sample(loop: JumpingLoop) -> None:
    link = MemoryLink(loop)
    LoadCellBoard(loop, link)
    drum = Drum(link, loop)
    await asyncio.sleep(1.0)
    await drum.connect()
    numbers: list[int] = []
    pauses_s = random.Random(3)
    while loop.time() < 121.0:
        numbers += [sample.raw_counts // 10 for sample in (await drum.poll()).loadcell]
        await asyncio.sleep(0.7 if pauses_s.random() < 0.01 else 0.03)
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    assert len(numbers) > 120 / 0.0124 - 60
    assert drum.state is not None
    assert drum.state.loadcell_lost == 0
    drum.close()


async def test_an_unexpected_restart_of_the_board_is_reported(loop: JumpingLoop) -> None:
    drum, board, _ = unconnected_drum(loop)
    await drum.connect()
    await asyncio.sleep(30)
    await drum.poll()
    await asyncio.sleep(0.04)
    clock = loop.time()
    board._loop = type("", (), {"time": lambda self: loop.time() - clock})()
    for _ in range(2):
        with pytest.raises(BoardRebooted, match="restarted: connect it again"):
            await drum.poll()
    assert not drum.connected
    board.put("boot_count", 42)
    await drum.connect()
    assert drum.rebooted
    await drum.poll()
    drum.close()
