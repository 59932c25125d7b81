"""A VIVE tracker: poses through a thread, lost tracking flagged, SteamVR's absence said."""

from __future__ import annotations

import asyncio
import sys
import threading
from collections.abc import Awaitable, Callable

import pytest

from rigctl.errors import LinkLost, RigFault
from rigctl.finger.trackers.streaming import OpenVrTracker
from rigctl.values import Position
from tests.finger.trackers.steamvr import SteamVR


class PoseListener:
    """Collects positions and losses; ``until`` waits for a condition on them."""

    def __init__(self) -> None:
        self.positions: list[Position] = []
        self.lost: list[str] = []
        self.threads: set[int] = set()
        self._changed = asyncio.Event()

    def on_position(self, position: Position) -> None:
        self.positions.append(position)
        self.threads.add(threading.get_ident())
        self._changed.set()

    def on_lost(self, reason: str) -> None:
        self.lost.append(reason)
        self._changed.set()

    async def until(self, done: Callable[[], object]) -> None:
        while not done():
            self._changed.clear()
            await asyncio.wait_for(self._changed.wait(), 60)


def with_steamvr(
    monkeypatch: pytest.MonkeyPatch,
    steamvr: SteamVR | None,
    main: Callable[[asyncio.AbstractEventLoop], Awaitable[None]],
) -> None:
    monkeypatch.setitem(sys.modules, "openvr", steamvr)

    async def in_loop() -> None:
        await main(asyncio.get_running_loop())

    asyncio.run(in_loop())


def test_positions_come_in_mm_and_lost_tracking_is_flagged(monkeypatch: pytest.MonkeyPatch) -> None:
    steamvr = SteamVR("LHR-1", "LHR-2")

    async def main(loop: asyncio.AbstractEventLoop) -> None:
        listener, tracker = PoseListener(), OpenVrTracker(loop, "LHR-2")
        tracker.open(listener.on_position, listener.on_lost)
        await listener.until(lambda: len(listener.positions) >= 5)
        first, second = listener.positions[:2]
        assert first[1:] == pytest.approx((1.0, 500.0, 4000.0, True))
        assert second.x_mm == pytest.approx(2.0) and second.at_s > first.at_s
        assert listener.threads == {threading.get_ident()}
        steamvr.tracking = steamvr.TrackingResult_Running_OutOfRange
        await listener.until(lambda: not listener.positions[-1].valid)
        steamvr.tracking = steamvr.TrackingResult_Running_OK
        await listener.until(lambda: listener.positions[-1].valid)
        steamvr.connected = False
        await listener.until(lambda: not listener.positions[-1].valid)
        tracker.close()
        tracker.close()
        assert (steamvr.sessions, listener.lost) == (0, [])
        assert tracker.counters.invalid > 0

    with_steamvr(monkeypatch, steamvr, main)


@pytest.mark.parametrize("quits", [True, False])
def test_steamvr_that_closes_or_dies_is_a_lost_tracker(
    monkeypatch: pytest.MonkeyPatch, quits: bool
) -> None:
    steamvr = SteamVR("LHR-1")

    async def main(loop: asyncio.AbstractEventLoop) -> None:
        listener, tracker = PoseListener(), OpenVrTracker(loop)
        tracker.open(listener.on_position, listener.on_lost)
        await listener.until(lambda: listener.positions)
        if quits:
            steamvr.events.extend([100, steamvr.VREvent_Quit])
        else:
            steamvr.running = False
        await listener.until(lambda: listener.lost)
        assert len(listener.lost) == 1
        assert listener.lost[0].startswith("vive: the tracker is gone: start SteamVR again (")
        assert (steamvr.sessions, steamvr.quit_acknowledged) == (0, quits)
        assert not tracker.is_open

    with_steamvr(monkeypatch, steamvr, main)


@pytest.mark.parametrize(
    ("serials", "serial", "sentence"),
    [
        ((), "", "SteamVR must have one tracker, it has none: switch one on"),
        (("LHR-1", "LHR-2"), "", "it has LHR-1, LHR-2: .*name it as vive:SERIAL"),
        (("LHR-1",), "LHR-9", "vive LHR-9: SteamVR has not this one but LHR-1: switch it on"),
    ],
)
def test_a_tracker_that_is_not_there_is_named(
    monkeypatch: pytest.MonkeyPatch, serials: tuple[str, ...], serial: str, sentence: str
) -> None:
    steamvr = SteamVR(*serials)

    async def main(loop: asyncio.AbstractEventLoop) -> None:
        listener = PoseListener()
        with pytest.raises(LinkLost, match=sentence):
            OpenVrTracker(loop, serial).open(listener.on_position, listener.on_lost)
        assert steamvr.sessions == 0

    with_steamvr(monkeypatch, steamvr, main)


def test_without_steamvr_or_its_package_one_sentence_says_so(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async def opened(loop: asyncio.AbstractEventLoop) -> None:
        listener = PoseListener()
        OpenVrTracker(loop).open(listener.on_position, listener.on_lost)

    steamvr = SteamVR("LHR-1")
    steamvr.running = False
    with pytest.raises(LinkLost, match="SteamVR does not run: start it"):
        with_steamvr(monkeypatch, steamvr, opened)
    with pytest.raises(RigFault, match=r"pip install 'rigctl\[vive\]'"):
        with_steamvr(monkeypatch, None, opened)
