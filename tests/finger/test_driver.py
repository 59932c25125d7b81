"""The finger board's driver with the board's own firmware, whole."""

from __future__ import annotations

import asyncio

import numpy as np
import pytest

from rigctl.boards.links import ByteLink
from rigctl.boards.taxel_frames import frame
from rigctl.errors import (
    CommandRefused,
    LinkLost,
    RigFault,
    WrongBoard,
    WrongUse,
)
from rigctl.finger import board_messages
from rigctl.finger.board_messages import (
    Answer,
    BatchReport,
    FingerSettings,
    Result,
    SampleFlag,
    ScanEnded,
    VelocitySource,
    WindowReport,
)
from rigctl.finger.driver import Finger
from tests.boards.memory_link import JumpingLoop, MemoryLink
from tests.finger.listener import HIGH, LOW, unconnected

IDENTITY = b"\x30\x47\x52\x01\x03\x02\x01\xef\xbe\xad\xde\x09\xe8\x03\x64"


async def test_connecting_gives_identity_and_whole_counters(loop: JumpingLoop) -> None:
    finger, board, _, listener = unconnected(loop)
    for _ in range(50):
        board.run(4000)
        board.firmware.take_sent()
    identity = await finger.connect()
    assert (identity.board, identity.wire_version) == ("finger", board_messages.WIRE_VERSION)
    assert identity.details == {"rate_hz": 1000, "batch_samples": 100}
    await asyncio.sleep(1.0)
    first = listener.counters[0]
    assert 200_000 <= first < 200_700
    assert listener.counters == list(range(first, first + len(listener.counters)))
    assert finger.counters.samples == len(listener.counters) > 900
    assert (finger.counters.lost, finger.counters.damaged_frames) == (0, 0)
    block = listener.blocks[-1]
    expected = 100 + (block.counters[:, None] + np.arange(9)) % 500
    assert np.array_equal(block.readings, expected)
    assert listener.arrivals_s[-1] == pytest.approx(loop.time(), abs=0.003)
    assert finger.status is not None and finger.status.samples > 200_000
    assert not finger.rebooted and listener.faults == []
    finger.close()


async def test_settings_are_set_and_read_back(loop: JumpingLoop) -> None:
    finger, _, _, _ = unconnected(loop)
    await finger.connect()
    assert await finger.configure(LOW, HIGH, 120_000) == FingerSettings(LOW, HIGH, 120_000)
    assert finger.settings == FingerSettings(LOW, HIGH, 120_000)
    for low, high, reference, sentence in [
        (LOW[:8], HIGH, 100_000, "give a range for each"),
        (HIGH, LOW, 100_000, "taxel 1: the range 600 to 90 is empty or outside 0 to 1023"),
        (LOW, (*HIGH[:8], 1024), 100_000, "taxel 9: the range 98 to 1024"),
        (LOW, HIGH, 999, "the reference speed 999 µm/s is outside 1000 to 10000000"),
    ]:
        with pytest.raises(WrongUse, match=sentence):
            await finger.configure(low, high, reference)
    assert finger.settings == FingerSettings(LOW, HIGH, 120_000)
    with pytest.raises(CommandRefused, match="set mean: its image has no classifier"):
        await finger.set_mean(0, [0.0] * 9)
    finger.close()


async def test_a_board_that_uses_other_settings_is_reported(loop: JumpingLoop) -> None:
    finger, board, link, _ = unconnected(loop)
    await finger.connect()
    ranges = board_messages.set_ranges(LOW, HIGH)
    other = board_messages.set_ranges(LOW, (*HIGH[:8], 700))
    link.board = lambda data: board.receive(data.replace(ranges, other))
    with pytest.raises(RigFault, match=r"uses FingerSettings.*700.* after it was set to"):
        await finger.configure(LOW, HIGH, 100_000)
    finger.close()


async def scan(finger: Finger, velocities: list[int | None], number: int = 7) -> None:
    """One scan with a velocity for each batch; None: it is lost on its way."""
    await finger.start(number)
    for batch, velocity in enumerate(velocities):
        await asyncio.sleep(0.1)
        if velocity is not None:
            finger.set_velocity(number, batch, velocity)
    await asyncio.sleep(0.05)  # a last batch is open whatever the phase of the samples is
    await finger.stop(number)
    await asyncio.sleep(0.05)


async def test_a_scan_gives_spikes_batches_windows_and_its_end(loop: JumpingLoop) -> None:
    finger, _, _, listener = unconnected(loop)
    await finger.connect()
    await finger.configure(LOW, HIGH, 100_000)
    await scan(finger, [100_000, 100_000, None, 50_000, 50_000])
    batches = listener.of(BatchReport)
    sources = [batch.source for batch in batches if isinstance(batch, BatchReport)]
    assert sources[:4] == [
        VelocitySource.RECEIVED,
        VelocitySource.RECEIVED,
        VelocitySource.HELD,
        VelocitySource.RECEIVED,
    ]
    assert len(listener.of(WindowReport)) >= 3
    assert ScanEnded(7) not in listener.messages
    finger.set_velocity(7, 5, 50_000)
    await asyncio.sleep(0.01)
    assert ScanEnded(7) in listener.messages
    with pytest.raises(CommandRefused, match="refused to set ranges: a scan is under way"):
        await finger.start(8)
        await finger.configure(LOW, HIGH, 100_000)
    in_scan = [
        row
        for block in listener.blocks
        for row, flag in zip(block.spikes, block.flags, strict=True)
        if flag & SampleFlag.IN_SCAN
    ]
    assert len(in_scan) > 490 and np.sum(in_scan) > 0
    assert listener.faults == []
    finger.close()


async def test_late_early_and_impossible_velocities_are_answered_not_raised(
    loop: JumpingLoop,
) -> None:
    finger, _, link, listener = unconnected(loop)
    await finger.connect()
    await finger.start(3)
    finger.set_velocity(3, 0, 100_000)
    await asyncio.sleep(0.35)
    finger.set_velocity(3, 0, 100_000)
    finger.set_velocity(3, 2, 4_000_000_000)
    await asyncio.sleep(0.2)
    results = [a.result for a in listener.of(Answer) if isinstance(a, Answer)]
    assert results == [Result.OK, Result.NOT_WAITING, Result.NOT_WAITING, Result.WRONG_VALUE]
    assert finger.status is not None
    assert (finger.status.early_velocities, finger.status.late_velocities) == (1, 1)
    for values in ((-1, 0, 0), (3, 0, -1), (3, 0, 2**32)):
        with pytest.raises(WrongUse, match="is outside 0 to 4294967295"):
            finger.set_velocity(*values)
    finger.close()
    with pytest.raises(LinkLost, match="the port is closed"):
        finger.set_velocity(3, 1, 100_000)
    assert not link.is_open


@pytest.mark.parametrize(
    ("byte", "value", "sentence"),
    [
        (1, 0x48, "the board there is not a finger board"),
        (4, 2, "the board there is not a finger board"),
        (
            3,
            9,
            r"firmware 1\.2 speaks wire version 9 .* this program version 2 .*rigctl flash finger",
        ),
        (11, 18, "with 18 taxels"),
        (14, 50, "in batches of 50"),
    ],
)
async def test_a_board_of_another_kind_or_wire_is_refused(
    loop: JumpingLoop, byte: int, value: int, sentence: str
) -> None:
    link = MemoryLink(loop, "/dev/finger")
    body = bytearray(IDENTITY)
    body[byte] = value
    link.board = lambda data: link.say(frame(bytes(body)), 0.001)
    with pytest.raises(WrongBoard, match=sentence):
        await Finger(link, loop).connect()
    assert not link.is_open


async def test_nobody_and_foreign_bytes_are_said_in_time(loop: JumpingLoop) -> None:
    link = MemoryLink(loop, "/dev/finger")
    finger = Finger(link, loop)
    with pytest.raises(LinkLost, match="no finger board answered within 4 s"):
        await finger.connect()
    link.board = lambda data: link.say(bytes(range(200)))
    with pytest.raises(WrongBoard, match="no complete reply from a finger board"):
        await finger.connect()
    link.plugged = False
    with pytest.raises(LinkLost, match="no such port"):
        await finger.connect()
    assert loop.time() < 9


async def test_the_other_board_on_the_port_is_named(loop: JumpingLoop) -> None:
    async def diagnose(link: ByteLink) -> str:
        return "the taxels board answers there"

    finger = Finger(MemoryLink(loop), loop, diagnose)
    with pytest.raises(WrongBoard, match="the taxels board answers there"):
        await finger.connect()
