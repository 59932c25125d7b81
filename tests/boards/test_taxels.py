"""The taxel board's driver: blocks in order, losses counted, silence and restarts reported."""

from __future__ import annotations

import asyncio
from dataclasses import replace

import numpy as np
import pytest

from rigctl.boards import taxel_frames
from rigctl.boards.drum_registers import BOARD_TAXELS, MAGIC
from rigctl.boards.taxel_frames import SelfTest
from rigctl.boards.taxels import Taxels
from rigctl.config.rig_config import TaxelArray
from rigctl.errors import BoardRebooted, LinkLost, RigFault, WrongBoard
from rigctl.values import Block
from tests.boards import taxel_encoder
from tests.boards.memory_link import JumpingLoop, MemoryLink

IDENTITY = taxel_frames.TaxelIdentity(
    *(MAGIC, taxel_frames.WIRE_VERSION, BOARD_TAXELS, 0x0102, 0xDEADBEEF),
    *(18, 1000, 7, 2, 800, 20),
)
STATUS = taxel_frames.TaxelStatus(0, 0, 0, 320, 5012, 2, 7, 900, 480, 3, 8)
EVERY_S = 0.01


class StreamingBoard:
    """Ten frames every 10 ms, a status every 100 frames, an identity on request."""

    def __init__(self, loop: JumpingLoop, link: MemoryLink, counter: int = 0) -> None:
        self.counter = counter
        self.identity: taxel_frames.TaxelIdentity | None = IDENTITY
        self.silent = False
        self.tested = SelfTest(1, 15, lines_low=0b010)
        self._loop = loop
        self._link = link
        link.board = self.on_request
        loop.call_later(EVERY_S, self.tick)

    def on_request(self, data: bytes) -> None:
        if (
            data == taxel_frames.encode_request(taxel_frames.IDENTIFY)
            and self.identity
            and not self.silent
        ):
            self._link.say(taxel_encoder.encode_identity(self.identity), 0.001)
            self._link.say(taxel_encoder.encode_self_test(self.tested), 0.001)
        elif data == taxel_frames.encode_request(taxel_frames.SELF_TEST) and not self.silent:
            self.tested = replace(self.tested, count=self.tested.count + 1)
            self._link.say(taxel_encoder.encode_self_test(self.tested), 0.021)

    def tick(self) -> None:
        counters = np.arange(self.counter, self.counter + 10)
        self.counter += 10
        samples = (counters[:, None] + np.arange(18)).astype(np.uint16) % 1024
        flags = np.zeros(10, np.uint8)
        data = taxel_encoder.encode_data(counters, samples, flags, flags)
        if self.counter % 100 == 0:
            boots = self.identity.boot_count if self.identity else 0
            data += taxel_encoder.encode_status(
                replace(STATUS, sample_counter=self.counter, boot_count=boots)
            )
        if not self.silent:
            self._link.say(data)
        self._loop.call_later(EVERY_S, self.tick)

    def reboot(self) -> None:
        assert self.identity is not None
        self.counter = 0
        self.identity = replace(self.identity, boot_count=self.identity.boot_count + 1)
        self._link.say(taxel_encoder.encode_identity(self.identity))


class Listener:
    """Collects the blocks and faults of the driver."""

    def __init__(self, taxels: Taxels) -> None:
        self.blocks: list[Block] = []
        self.faults: list[tuple[float, RigFault]] = []
        taxels.on_block(self.blocks.append)
        taxels.on_fault(lambda fault: self.faults.append((taxels._loop.time(), fault)))

    @property
    def counters(self) -> list[int]:
        return [int(c) for block in self.blocks for c in block.counters]


def unconnected_board(
    loop: JumpingLoop, counter: int = 0, array: TaxelArray | None = None
) -> tuple[Taxels, StreamingBoard, MemoryLink, Listener]:
    link = MemoryLink(loop, "/dev/taxels")
    board = StreamingBoard(loop, link, counter)
    taxels = Taxels(link, loop, array=array)
    return taxels, board, link, Listener(taxels)


async def test_connecting_to_a_board_that_has_run_for_hours_gives_its_whole_counter(
    loop: JumpingLoop,
) -> None:
    taxels, _, _, listener = unconnected_board(loop, counter=5_000_000)
    identity = await taxels.connect()
    assert (identity.board, identity.firmware_version) == ("taxels", "1.2")
    await asyncio.sleep(1.0)
    first = listener.counters[0]
    assert 5_000_000 < first < 5_000_300
    assert listener.counters == list(range(first, first + len(listener.counters)))
    assert taxels.counters.frames == len(listener.counters) > 900
    assert taxels.counters.lost == taxels.counters.rejected_frames == 0
    assert taxels.status is not None
    assert taxels.status.supply_mv == 5012
    taxels.close()


async def test_a_stream_without_an_identity_is_refused(loop: JumpingLoop) -> None:
    taxels, board, link, _ = unconnected_board(loop)
    board.identity = None
    with pytest.raises(WrongBoard, match="no complete reply from a taxel board"):
        await taxels.connect()
    assert not link.is_open


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"board_id": 1}, "not a taxel board"),
        ({"magic": 1}, "not a taxel board"),
        ({"wire_version": 3}, "firmware 1.2 speaks wire version 3, .*`rigctl flash taxels`"),
        ({"n_taxels": 16}, "sends 16 taxels, rig.toml describes 18: correct .*`rigctl flash"),
    ],
)
async def test_another_board_or_firmware_is_refused(
    loop: JumpingLoop, change: dict[str, int], sentence: str
) -> None:
    taxels, board, _, _ = unconnected_board(loop, array=TaxelArray())
    board.identity = replace(IDENTITY, **change)
    with pytest.raises(WrongBoard, match=sentence):
        await taxels.connect()


async def test_nobody_there_is_said_in_time(loop: JumpingLoop) -> None:
    taxels, board, link, _ = unconnected_board(loop)
    board.silent = True
    with pytest.raises(LinkLost, match="no taxel board answered within 4 s"):
        await taxels.connect()
    assert loop.time() < 5
    board.silent = False
    await taxels.connect()
    link.unplug()
    with pytest.raises(LinkLost, match="no such port"):
        await taxels.connect()


async def test_silence_is_reported_within_0_3_s(loop: JumpingLoop) -> None:
    taxels, board, link, listener = unconnected_board(loop)
    await taxels.connect()
    await asyncio.sleep(0.5)
    board.silent, silent_s = True, loop.time()
    await asyncio.sleep(1.0)
    ((at_s, fault),) = listener.faults
    assert isinstance(fault, LinkLost)
    assert at_s - silent_s < 0.3
    assert not link.is_open


async def test_an_unplug_is_reported_and_the_gap_is_counted_after_the_replug(
    loop: JumpingLoop,
) -> None:
    taxels, _, link, listener = unconnected_board(loop)
    await taxels.connect()
    await asyncio.sleep(0.5)
    link.unplug()
    assert [str(fault) for _, fault in listener.faults] == ["/dev/taxels: the port vanished"]
    last = listener.counters[-1]
    await asyncio.sleep(100.0)
    link.plugged = True
    await taxels.connect()
    await asyncio.sleep(0.3)
    assert not taxels.rebooted
    (gap,) = [gap for block in listener.blocks for gap in block.gaps]
    assert gap.first_counter == last + 1
    assert gap.count == listener.counters[listener.counters.index(last) + 1] - last - 1 > 100_000
    assert taxels.counters.lost == gap.count
    taxels.close()


async def test_a_restart_of_the_board_is_reported_with_and_without_a_replug(
    loop: JumpingLoop,
) -> None:
    taxels, board, link, listener = unconnected_board(loop)
    await taxels.connect()
    await asyncio.sleep(0.5)
    board.reboot()
    await asyncio.sleep(0.5)
    assert [type(fault) for _, fault in listener.faults] == [BoardRebooted]
    assert taxels.counters.lost == 0
    link.unplug()
    board.reboot()
    link.plugged = True
    await taxels.connect()
    assert taxels.rebooted
    taxels.close()


async def test_a_failing_consumer_is_reported_and_the_others_continue(loop: JumpingLoop) -> None:
    taxels, _, _, listener = unconnected_board(loop)

    def fails(block: Block) -> None:
        raise KeyError("oops")

    taxels.on_block(fails)
    await taxels.connect()
    await asyncio.sleep(0.5)
    assert [str(fault) for _, fault in listener.faults] == [
        "/dev/taxels: a consumer of samples failed: KeyError('oops')"
    ]
    assert len(listener.counters) > 400
    taxels.close()


async def test_samples_come_in_the_sensors_order_and_polarity(loop: JumpingLoop) -> None:
    wiring = (5, 0, 1, 2, 3, 4, *range(17, 5, -1))
    array = TaxelArray(wiring=wiring, pressure_raises=False)
    taxels, _, _, listener = unconnected_board(loop, array=array)
    await taxels.connect()
    await asyncio.sleep(0.3)
    block = listener.blocks[-1]
    wired = (block.counters[:, None] + np.array(wiring)) % 1024
    assert np.array_equal(block.samples, 1023 - wired)
    assert block.samples.dtype == np.uint16 and block.samples.flags.c_contiguous
    taxels.close()


async def test_the_outcome_of_a_self_test_is_received_and_requested(loop: JumpingLoop) -> None:
    taxels, board, _, _ = unconnected_board(loop)
    told: list[SelfTest] = []
    taxels.on_self_test(told.append)
    await taxels.connect()
    assert taxels.self_test == board.tested
    assert taxels.findings == ["line D5 stays low: it is connected to ground; free it"]
    assert (await taxels.test()).count == 2
    assert [test.count for test in told] == [1, 2]
    board.silent = True
    with pytest.raises(LinkLost, match="no outcome of its self-test"):
        await taxels.test()
    taxels.close()
