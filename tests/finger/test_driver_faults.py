"""The finger board's driver with damaged streams, reboots, silence and unplugs."""

from __future__ import annotations

import asyncio

import numpy as np
import pytest

from rigctl.errors import BoardRebooted, LinkLost
from rigctl.finger import board_messages
from rigctl.finger.board_messages import BatchReport
from tests.boards.memory_link import JumpingLoop
from tests.finger.listener import HIGH, LOW, unconnected


async def test_a_damaged_stream_costs_its_frames_and_all_are_counted(loop: JumpingLoop) -> None:
    finger, board, _, listener = unconnected(loop)
    await finger.connect()
    random = np.random.default_rng(1)

    def spoil(data: bytes) -> bytes:
        spoiled = bytearray(data)
        if random.random() < 0.2:
            spoiled[random.integers(len(spoiled))] ^= 1 << int(random.integers(8))
        return bytes(spoiled)

    board.spoil = spoil
    await asyncio.sleep(2.0)
    board.spoil = lambda data: data
    await asyncio.sleep(0.2)
    first, last = listener.counters[0], listener.counters[-1]
    assert finger.counters.damaged_frames > 100
    assert 100 < listener.missing == finger.counters.lost
    assert len(listener.counters) + listener.missing == last - first + 1
    assert (np.diff(listener.counters) > 0).all()
    assert listener.faults == []
    finger.close()


async def test_requests_that_are_lost_are_repeated_only_where_that_does_no_harm(
    loop: JumpingLoop,
) -> None:
    finger, board, link, _ = unconnected(loop)
    await finger.connect()
    lose = [
        board_messages.set_ranges(LOW, HIGH),
        board_messages.read_settings(),
        board_messages.start(5),
    ]

    def receive(data: bytes) -> None:
        if data in lose:
            lose.remove(data)
        else:
            board.receive(data)

    link.board = receive
    await finger.configure(LOW, HIGH, 100_000)
    with pytest.raises(LinkLost, match=r"sent no Answer within 0\.5 s: check the cable"):
        await finger.start(5)
    assert link.written.count(board_messages.start(5)) == 1
    assert lose == []
    finger.close()


@pytest.mark.parametrize("after_s", [0.3, 1.0])
async def test_a_reboot_is_noticed_and_its_samples_are_not_mixed_in(
    loop: JumpingLoop, after_s: float
) -> None:
    finger, board, _, listener = unconnected(loop)
    await finger.connect()
    await finger.configure(LOW, HIGH, 100_000)
    await asyncio.sleep(after_s)
    loop.call_later(0.05, board.reboot)
    await finger.start(1)
    await asyncio.sleep(0.4)
    assert [type(fault) for fault in listener.faults] == [BoardRebooted]
    assert "restarted with its default settings" in str(listener.faults[0])
    assert (finger.counters.reboots, finger.counters.lost, listener.missing) == (1, 0, 0)
    assert listener.counters[-1] < 1000
    await finger.connect()
    assert finger.rebooted
    await finger.connect()
    assert not finger.rebooted
    finger.close()


async def test_a_reboot_whose_identity_is_lost_is_noticed_by_the_samples(loop: JumpingLoop) -> None:
    finger, board, _, listener = unconnected(loop)
    await finger.connect()
    await asyncio.sleep(0.5)
    board.spoil = lambda data: data[1:]
    board.reboot()
    board.spoil = lambda data: data
    await asyncio.sleep(0.3)
    assert [type(fault) for fault in listener.faults] == [BoardRebooted]
    finger.close()


async def test_repeated_frames_are_no_reboot_and_no_second_report(loop: JumpingLoop) -> None:
    finger, board, _, listener = unconnected(loop)
    await finger.connect()
    await finger.configure(LOW, HIGH, 100_000)
    board.spoil = lambda data: b"".join(part + b"\0" + part + b"\0" for part in data.split(b"\0"))
    await finger.start(7)
    for batch in range(3):
        await asyncio.sleep(0.1)
        finger.set_velocity(7, batch, 100_000)
    await asyncio.sleep(0.05)
    board.reboot()
    await asyncio.sleep(0.3)
    batches = [b.batch for b in listener.messages if isinstance(b, BatchReport)]
    assert batches == [0, 1, 2]
    assert (np.diff([c for c in listener.counters if c >= 300]) == 1).all()
    assert (finger.counters.reboots, finger.counters.lost) == (1, 0)
    assert finger.counters.stale_frames > 300
    finger.close()


async def test_a_reboot_ends_the_wait_for_an_answer(loop: JumpingLoop) -> None:
    finger, board, link, _ = unconnected(loop)
    await finger.connect()
    link.board = lambda data: board.reboot()
    with pytest.raises(BoardRebooted, match="restarted"):
        await finger.start(1)
    assert loop.time() < 1.0
    finger.close()


async def test_silence_is_reported_within_0_3_s(loop: JumpingLoop) -> None:
    finger, board, link, listener = unconnected(loop)
    await finger.connect()
    await asyncio.sleep(0.5)
    board.silent, silent_s = True, loop.time()
    while not listener.faults:
        await asyncio.sleep(0.01)
    assert loop.time() - silent_s < 0.3
    assert [str(fault) for fault in listener.faults] == [
        "/dev/finger: no finger sample for 0.2 s: check the cable"
    ]
    assert not link.is_open and not finger.connected
    await asyncio.sleep(1.0)
    assert len(listener.faults) == 1


async def test_an_unplug_is_reported_and_the_gap_is_counted_after_the_replug(
    loop: JumpingLoop,
) -> None:
    finger, board, link, listener = unconnected(loop)
    await finger.connect()
    await asyncio.sleep(0.5)
    pending = asyncio.create_task(finger.stop(1))
    link.board = lambda data: link.unplug()
    with pytest.raises(LinkLost, match="the port vanished"):
        await pending
    link.board = board.receive
    assert [str(fault) for fault in listener.faults] == ["/dev/finger: the port vanished"]
    last = listener.counters[-1]
    await asyncio.sleep(200.0)
    link.plugged = True
    await finger.connect()
    await asyncio.sleep(0.1)
    assert not finger.rebooted
    first = listener.counters[listener.counters.index(last) + 1]
    assert listener.missing == first - last - 1 == finger.counters.lost > 199_000
    link.unplug()
    board.reboot()
    link.plugged = True
    await finger.connect()
    assert finger.rebooted
    assert finger.counters.lost == listener.missing
    finger.close()


@pytest.mark.parametrize("of", ["samples", "messages"])
async def test_a_consumer_that_raises_is_reported_once_and_the_others_continue(
    loop: JumpingLoop, of: str
) -> None:
    finger, _, _, listener = unconnected(loop)

    def fails(value: object, at_s: float) -> None:
        raise KeyError("oops")

    (finger.on_block if of == "samples" else finger.on_message)(fails)
    await finger.connect()
    await asyncio.sleep(0.5)
    assert [str(fault) for fault in listener.faults] == [
        "/dev/finger: a consumer of samples failed: KeyError('oops')"
    ]
    assert len(listener.counters) > 400
    finger.close()
