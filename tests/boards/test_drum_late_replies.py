"""Replies that come late, twice, or to what was overtaken: none answers another request."""

from __future__ import annotations

import asyncio

import pytest

from rigctl.boards.drum_codes import Command
from rigctl.boards.modbus_client import PreemptedByStop
from tests.boards.memory_link import (
    JumpingLoop,
    rtu,
    unconnected_drum,
)


async def test_a_late_reply_to_an_older_poll_is_ignored(loop: JumpingLoop) -> None:
    drum, board, _ = unconnected_drum(loop)
    await drum.connect()
    await drum.poll()
    board.reply_s = 0.07
    loop.call_later(0.065, setattr, board, "reply_s", 0.001)
    state = await drum.poll()
    assert state.values["heartbeat_seen"] == 2
    assert drum.modbus.stale == 0
    drum.close()


async def test_a_stop_waits_for_no_reply(loop: JumpingLoop) -> None:
    drum, board, link = unconnected_drum(loop)
    await drum.connect()
    board.reply_s = 0.05
    poll = asyncio.create_task(drum.poll())
    await asyncio.sleep(0.001)
    setting = asyncio.create_task(drum.set(speed_set=80))
    running = asyncio.create_task(drum.command(Command.RUN))
    await asyncio.sleep(0.001)
    asked_s, board.reply_s = loop.time(), 0.001
    stop = asyncio.create_task(drum.stop())
    await asyncio.sleep(1e-4)
    assert link.written[-1][1:11].hex() == "10004100020400070002"
    await stop
    assert loop.time() - asked_s < 0.1
    assert board.executed == [(Command.STOP, 2)]
    assert (await poll).at_s > asked_s
    assert (await setting)["speed_set"] == 80.0
    with pytest.raises(PreemptedByStop, match="a stop preempted this request"):
        await running
    assert [command for command, _ in board.executed] == [Command.STOP]
    drum.close()


async def test_stops_of_several_clients_at_once_are_all_answered(loop: JumpingLoop) -> None:
    """The second stop abandoned the reply to the first, which then counted as refused."""
    drum, board, _ = unconnected_drum(loop)
    await drum.connect()
    board.reply_s = 0.01
    stops = []
    for _ in range(3):
        stops.append(asyncio.create_task(drum.stop()))
        await asyncio.sleep(0.001)
    assert await asyncio.gather(*stops) == [None, None, None]
    assert {command for command, _ in board.executed} == {Command.STOP}
    assert {sequence for _, sequence in board.executed} == {1, 2, 3}
    drum.close()


async def test_a_command_overtaken_by_a_stop_is_not_repeated(loop: JumpingLoop) -> None:
    drum, board, _ = unconnected_drum(loop)
    await drum.connect()
    board.reply_s = 0.05
    running = asyncio.create_task(drum.command(Command.RUN))
    await asyncio.sleep(0.001)
    board.reply_s = 0.001
    await drum.stop()
    with pytest.raises(PreemptedByStop, match="a stop preempted this request"):
        await running
    assert [command for command, _ in board.executed] == [Command.RUN, Command.STOP]
    drum.close()


async def test_a_late_reply_to_an_abandoned_command_does_not_answer_the_stop(
    loop: JumpingLoop,
) -> None:
    """Both are acknowledged by the same bytes; the stop itself was lost."""
    drum, board, link = unconnected_drum(loop)
    await drum.connect()
    board.reply_s = 0.03
    command = asyncio.create_task(drum.command(Command.ARM))
    await asyncio.sleep(0.02)
    stops: list[bytes] = []

    def lose_the_first_stop(request: bytes) -> None:
        stops.append(request)
        if len(stops) > 1:
            board.receive(request)

    link.board = lose_the_first_stop
    await drum.stop()
    with pytest.raises(PreemptedByStop):
        await command
    assert [kind for kind, _ in board.executed] == [Command.ARM, Command.STOP]
    assert len(set(stops)) == 1
    drum.close()


async def test_a_repeated_reply_does_not_answer_the_next_request(loop: JumpingLoop) -> None:
    drum, board, link = unconnected_drum(loop)
    await drum.connect()
    await drum.command(Command.ARM)
    link.say(rtu(bytes.fromhex("10 0041 0002")), 0.001)
    link.board = lambda request: setattr(link, "board", board.receive)
    await drum.command(Command.STOP)
    assert [kind for kind, _ in board.executed] == [Command.ARM, Command.STOP]
    drum.close()
