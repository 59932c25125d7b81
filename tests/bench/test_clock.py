"""The event loop runs in simulated time: timeouts, sleeps and files without a wall clock."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Callable, Iterator

import pytest

from rigctl.bench.clock import SimulatedTimeLoop
from rigctl.bench.ground_truth import GroundTruth
from rigctl.bench.simulated_rig import (
    DRUM,
    TAXELS,
    Disturbances,
    FaultInjection,
    SimulatedLink,
)


class ClockOnly:
    """A simulation in which only time passes, with callbacks at given times."""

    def __init__(self, slice_us: int = 5000) -> None:
        self.time_us = 0
        self.slice_us = slice_us
        self.drum = SimulatedLink(DRUM)
        self.taxels = SimulatedLink(TAXELS)
        self.truth = GroundTruth()
        self.advances: list[int] = []
        self.at: dict[int, Callable[[], None]] = {}
        links = {DRUM: self.drum, TAXELS: self.taxels}
        self.faults = FaultInjection(links, Disturbances(), lambda: None, print, print)

    def advance(self, until_us: int) -> None:
        assert until_us > self.time_us
        self.time_us = until_us
        self.advances.append(until_us)
        for due in sorted(t for t in self.at if t <= until_us):
            self.at.pop(due)()

    def set_plate(self, texture: str) -> None:
        pass

    def skip_mountings(self, count: int) -> None:
        pass

    def close(self) -> None:
        pass


@pytest.fixture
def loop() -> Iterator[SimulatedTimeLoop]:
    loop = SimulatedTimeLoop(ClockOnly())
    yield loop
    loop.close()


def test_sleep_of_an_hour_ends_at_the_exact_simulated_time() -> None:
    loop = SimulatedTimeLoop(ClockOnly(slice_us=10_000_000))

    async def sleep() -> float:
        await asyncio.sleep(3600)
        return loop.time()

    assert loop.run_until_complete(sleep()) == 3600.0
    loop.close()


def test_the_simulation_never_passes_the_earliest_timer(loop: SimulatedTimeLoop) -> None:
    fired: list[float] = []
    for delay_us in (1, 2, 7, 290, 4999, 5000, 5001, 70_000, 123_457):
        loop.call_later(delay_us / 1e6, lambda: fired.append(loop.time()))

    loop.run_until_complete(asyncio.sleep(0.2))

    assert fired == [t / 1e6 for t in (1, 2, 7, 290, 4999, 5000, 5001, 70_000, 123_457)]


def test_timeout_is_simulated_time(loop: SimulatedTimeLoop) -> None:
    async def wait_for_nothing() -> float:
        with pytest.raises(TimeoutError):
            await asyncio.wait_for(loop.create_future(), 0.06)
        return loop.time()

    assert loop.run_until_complete(wait_for_nothing()) == 0.06


def test_an_event_of_the_simulation_wakes_a_task_in_the_same_slice(
    loop: SimulatedTimeLoop,
) -> None:
    async def wait() -> float:
        future = loop.create_future()
        simulation = loop.simulation
        assert isinstance(simulation, ClockOnly)
        simulation.at[7_000] = lambda: future.set_result(None)
        await future
        return loop.time()

    assert loop.run_until_complete(wait()) == 0.010


def test_real_sockets_are_served_while_the_simulation_runs(loop: SimulatedTimeLoop) -> None:
    here, there = socket.socketpair()
    here.setblocking(False)

    async def echo() -> bytes:
        there.sendall(b"hello")
        return await loop.sock_recv(here, 16)

    with here, there:
        assert loop.run_until_complete(echo()) == b"hello"


def test_a_call_from_another_thread_is_served(loop: SimulatedTimeLoop) -> None:
    async def work() -> int:
        return await loop.run_in_executor(None, lambda: 42)

    assert loop.run_until_complete(work()) == 42
    loop.run_until_complete(loop.shutdown_default_executor())


def test_a_paced_loop_stops_at_its_timers_too() -> None:
    loop = SimulatedTimeLoop(ClockOnly(), pace=50.0)
    try:

        async def sleep() -> float:
            await asyncio.sleep(0.0123)
            return loop.time()

        assert loop.run_until_complete(sleep()) == 0.0123
    finally:
        loop.close()


def test_a_paced_loop_ends_its_steps_where_a_cable_delivers() -> None:
    simulation = ClockOnly(slice_us=20_000)
    loop = SimulatedTimeLoop(simulation, pace=50.0)
    try:
        for timer_s in (0.0123, 0.0301):
            loop.call_later(timer_s, lambda: None)
        loop.run_until_complete(asyncio.sleep(0.06))
        assert {20_000, 40_000, 60_000} <= set(simulation.advances)
    finally:
        loop.close()


def test_a_busy_client_does_not_stop_a_paced_simulation() -> None:
    loop = SimulatedTimeLoop(ClockOnly(), pace=50.0)
    here, there = socket.socketpair()
    here.setblocking(False)

    async def chat() -> None:
        there.sendall(b"never read, so the file stays ready")
        await asyncio.sleep(0.05)

    with here, there:
        loop.add_reader(here, lambda: None)
        loop.run_until_complete(chat())
        assert loop.time() == 0.05
        loop.remove_reader(here)
        loop.close()
