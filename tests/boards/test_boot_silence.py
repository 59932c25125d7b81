"""Connect, reconnect and resets while polling, with the real bootloaders in front of the images."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from functools import partial
from pathlib import Path

import pytest

from rigctl.bench.simulated_rig import DRUM, TAXELS
from rigctl.boards import boot_silence
from rigctl.engine.poller import DrumPoller
from rigctl.errors import LinkLost, RigFault
from tests.boards.boot_bench import BootBench
from tests.firmware.bootloaders import MEGA, OLD_NANO, UNO


def test_a_mega_answers_the_first_connect() -> None:
    async def main(bench: BootBench) -> None:
        said: list[str] = []
        bench.drum.silence.on_begin = said.append
        identity = await bench.drum.connect()
        assert identity.board == "drum"
        assert bench.loop.time() < 2.2
        assert said == ["drum: the board's bootloader may be listening: silent for 2 s"]
        await bench.drum.poll()

    BootBench({DRUM: MEGA}).run(main)


@pytest.mark.parametrize("silence_s", [0.0, 0.5])
def test_a_mega_that_is_asked_too_early_never_answers(
    monkeypatch: pytest.MonkeyPatch, silence_s: float
) -> None:
    """What the silence is for: a request every 60 ms keeps the bootloader listening."""
    monkeypatch.setattr(boot_silence, "AFTER_OPEN_S", silence_s)
    monkeypatch.setattr(boot_silence, "ASK_S", 6.0)

    async def main(bench: BootBench) -> None:
        with pytest.raises(LinkLost, match="no drum board answered"):
            await bench.drum.connect()

    BootBench({DRUM: MEGA}).run(main)


@pytest.mark.parametrize("bootloader", [UNO, OLD_NANO], ids=["uno", "old nano"])
def test_an_uno_and_an_old_nano_answer_the_first_connect(bootloader: Path) -> None:
    async def main(bench: BootBench) -> None:
        identity = await bench.taxels.connect()
        assert identity.board == "taxels"
        assert bench.loop.time() < 2.5

    BootBench({TAXELS: bootloader}).run(main)


async def _poll_through(bench: BootBench, disturb: Callable[[], object], cause_text: str) -> None:
    """Poll a Mega as the engine does, disturb it, and expect it back with another boot count."""
    lost: list[str] = []
    back: asyncio.Future[int] = bench.loop.create_future()
    said: list[str] = []
    bench.drum.silence.on_begin = said.append
    poller = DrumPoller(
        bench.drum,
        bench.loop,
        on_lost=lost.append,
        on_reconnected=lambda identity, rebooted: back.set_result(identity.boot_count),
    )
    first = await poller.connect()
    polling = asyncio.create_task(poller.run())
    await asyncio.sleep(1.0)
    disturb()
    assert await asyncio.wait_for(back, 20.0) == first.boot_count + 1
    assert bench.drum.rebooted
    assert len(lost) == 1
    assert any(cause_text in text for text in said)
    await poller.wait_cycle()
    assert poller.connected
    polling.cancel()


AFTER_LOSS = "the board's bootloader may be listening: silent for 5 s"


def test_a_mega_whose_reset_button_is_pressed_while_polling_is_back() -> None:
    async def main(bench: BootBench) -> None:
        await _poll_through(bench, partial(bench.simulation.faults.reset, DRUM), AFTER_LOSS)
        assert bench.simulation.drum_board.chip.io.resets == 2  # by opening the port, and by hand

    BootBench({DRUM: MEGA}).run(main)


def test_a_mega_whose_supply_dips_while_polling_is_back() -> None:
    async def main(bench: BootBench) -> None:
        await _poll_through(bench, partial(bench.simulation.dip_supply, DRUM), AFTER_LOSS)

    BootBench({DRUM: MEGA}).run(main)


def test_a_mega_that_is_unplugged_and_plugged_in_again_is_back() -> None:
    async def main(bench: BootBench) -> None:
        def replug() -> None:
            bench.simulation.faults.unplug(DRUM)
            bench.loop.call_later(3.0, bench.simulation.faults.replug, DRUM)

        await _poll_through(bench, replug, "silent for 2 s")

    BootBench({DRUM: MEGA}).run(main)


def test_a_mega_is_not_back_without_the_silence_after_a_loss(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The control: polls that go on after a reset keep the bootloader listening for good."""
    monkeypatch.setattr(boot_silence, "AFTER_LOSS_S", 0.0)

    async def main(bench: BootBench) -> None:
        with pytest.raises(TimeoutError):
            await _poll_through(bench, partial(bench.simulation.faults.reset, DRUM), AFTER_LOSS)

    BootBench({DRUM: MEGA}).run(main)


@pytest.mark.parametrize("bootloader", [UNO, OLD_NANO], ids=["uno", "old nano"])
def test_a_taxel_board_whose_reset_button_is_pressed_is_back(bootloader: Path) -> None:
    async def main(bench: BootBench) -> None:
        taxels = bench.taxels
        faults: list[RigFault] = []
        taxels.on_fault(faults.append)
        first = await taxels.connect()
        bench.simulation.faults.reset(TAXELS)
        await asyncio.sleep(0.5)
        assert isinstance(faults[0], LinkLost)
        said: list[str] = []
        taxels.silence.on_begin = said.append
        again = await _until_connected(taxels.connect)
        assert len(said) == (bootloader == UNO)  # the old Nano's leaves at once
        assert all("5 s; a Nano with the old bootloader restarts for" in text for text in said)
        assert again.boot_count == first.boot_count + 1  # type: ignore[attr-defined]
        assert taxels.rebooted

    BootBench({TAXELS: bootloader}).run(main)


async def _until_connected(connect: Callable[[], Awaitable[object]]) -> object:
    for _ in range(20):
        try:
            return await connect()
        except LinkLost:
            await asyncio.sleep(0.5)
    raise AssertionError("it never answered")


def test_one_lost_reply_does_not_silence_the_heartbeat() -> None:
    async def main(bench: BootBench) -> None:
        await bench.drum.connect()
        before = (await bench.drum.poll()).values["heartbeat_seen"]
        bench.simulation.faults.stall(DRUM)
        bench.loop.call_later(0.05, bench.simulation.faults.stall, DRUM, False)
        state = await bench.drum.poll()
        assert state.values["heartbeat_seen"] == before + 1
        assert not bench.drum.silence.is_on

    BootBench({DRUM: MEGA}).run(main)


def test_a_stop_is_sent_into_the_silence_and_nothing_else_is() -> None:
    async def main(bench: BootBench) -> None:
        await bench.drum.connect()
        bench.simulation.faults.stall(DRUM)
        await asyncio.sleep(1.5)
        with pytest.raises(LinkLost, match="silent for 5 s; then it is asked again"):
            await bench.drum.connect()
        with pytest.raises(LinkLost, match="may be listening: silent for 5 s"):
            await bench.drum.set(speed_set=40)
        bench.simulation.faults.stall(DRUM, False)
        await bench.drum.stop()
        assert not bench.drum.silence.is_on  # the answer shows that the program runs
        await bench.drum.set(speed_set=40)

    BootBench({DRUM: MEGA}).run(main)


def test_the_port_is_opened_once() -> None:
    async def main(bench: BootBench) -> None:
        await bench.drum.connect()
        resets = bench.simulation.drum_board.chip.io.resets
        bench.simulation.faults.stall(DRUM)
        await asyncio.sleep(1.5)
        for _ in range(2):
            with pytest.raises(LinkLost):
                await bench.drum.connect()
        bench.simulation.faults.stall(DRUM, False)
        await bench.drum.connect()
        assert not bench.drum.rebooted
        await asyncio.sleep(0.01)
        assert bench.simulation.drum_board.chip.io.resets == resets

    BootBench({DRUM: MEGA}).run(main)
