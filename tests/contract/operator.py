"""Somebody at the rig: polls with the heartbeat, walks from state to state, keeps a record."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from rigctl.errors import LinkLost, RigFault
from rigctl.rig import Rig
from rigctl.simulation.bench.parameters import WorldParameters
from rigctl.values import Block, DrumState
from rigctl.wire.drum.codes import Command, CommandResult, Status
from rigctl.wire.drum.states import Fault, State

Result = TypeVar("Result")
POLL_S = 0.04
NOMINAL = WorldParameters()
WAY = {
    State.IDLE: Command.ARM,
    State.ARMED: Command.APPROACH,
    State.HOLD: Command.RUN,
}
"""The command that leads on from a state, towards contact."""


class Operator:
    """One simulated rig in the hands of a test. World time passes inside :meth:`run` only."""

    def __init__(self, rig: Rig) -> None:
        assert rig.simulation is not None
        assert rig.faults is not None
        self.rig, self.drum, self.taxels = rig, rig.drum, rig.taxels
        self.simulation, self.faults = rig.simulation, rig.faults
        self.clocks_ppm = {"drum": NOMINAL.drum_clock_ppm, "taxels": NOMINAL.taxel_clock_ppm}
        self.states: list[DrumState] = []
        self.blocks: list[Block] = []
        self.taxel_faults: list[RigFault] = []
        rig.drum.on_state(self.states.append)
        rig.taxels.on_block(self.blocks.append)
        rig.taxels.on_fault(self.taxel_faults.append)

    def run(self, work: Coroutine[Any, Any, Result]) -> Result:
        """Do ``work`` while the world goes on."""
        return self.rig.loop.run_until_complete(work)

    @property
    def now_s(self) -> float:
        """World time."""
        return self.rig.loop.time()

    @property
    def state(self) -> State:
        """State of the newest poll."""
        return State(self.states[-1].state)

    @property
    def fault(self) -> Fault:
        """Latched fault of the newest poll."""
        return Fault(self.states[-1].fault)

    def shows(self, status: Status) -> bool:
        """A status bit of the newest poll."""
        return bool(self.states[-1].status_bits >> status & 1)

    def forget(self) -> None:
        """Begin a new record."""
        self.states.clear()
        self.blocks.clear()
        self.taxel_faults.clear()

    async def connect(self) -> None:
        """Both boards; their settings as the nominal rig has them."""
        await self.drum.connect()
        await self.taxels.connect()
        await self.drum.poll()

    async def until(
        self, done: Callable[[DrumState], bool], limit_s: float = 15.0, beat: bool = True
    ) -> DrumState:
        """Poll 25 times a second until a state is ``done``."""
        end_s = self.now_s + limit_s
        while self.now_s < end_s:
            state = await self.drum.poll(beat)
            if done(state):
                return state
            await asyncio.sleep(POLL_S)
        raise AssertionError(f"not done within {limit_s} s: {self.state.name}, {self.fault.name}")

    async def watch(self, seconds: float, beat: bool = True) -> None:
        """Poll for some time."""
        end_s = self.now_s + seconds
        await self.until(lambda state: self.now_s >= end_s, seconds + 1, beat)

    async def until_state(self, state: State, limit_s: float = 15.0) -> DrumState:
        """Poll until the drum is in ``state``."""
        return await self.until(lambda now: now.state == state, limit_s)

    async def reach(self, goal: State) -> None:
        """From whatever state, to IDLE, ARMED, HOLD or RUN."""
        await self._make_sound()
        if State(self.states[-1].state) not in (State.IDLE, goal):
            await self.drum.stop()
            await self.until(lambda s: s.state in (State.ARMED, State.IDLE))
        if goal is State.IDLE and self.state is not State.IDLE:
            await self.do(Command.DISARM)
        while self.state is not goal:
            if self.state is State.ARMED and not self.shows(Status.TARED):
                await self.do(Command.TARE)
            command = WAY[self.state]
            await self.drum.command(command)
            await self.until(lambda s, c=command: s.state == goal or _done(s))

    async def do(self, command: Command, limit_s: float = 15.0) -> DrumState:
        """Give a command and poll until it is done."""
        await self.drum.command(command)
        return await self.until(_done, limit_s)

    async def _make_sound(self) -> None:
        """Connected, and no fault latched."""
        if not self.taxels.connected:
            await self.taxels.connect()
        if not self.drum.connected:
            await self.drum.connect()
        state = await self.drum.poll()
        if state.fault:
            await self.until_state(State.FAULT_OFF)
            await self.do(Command.CLEAR)

    @property
    def counters(self) -> NDArray[np.int64]:
        """Counters of every sample heard."""
        return np.concatenate([block.counters for block in self.blocks])

    @property
    def flags(self) -> NDArray[np.uint8]:
        """Flags of every sample heard."""
        return np.concatenate([block.flags for block in self.blocks])

    @property
    def edges(self) -> NDArray[np.uint8]:
        """Edge counts of every sample heard."""
        return np.concatenate([block.edges for block in self.blocks])

    @property
    def samples(self) -> NDArray[np.uint16]:
        """Readings of every sample heard."""
        return np.concatenate([block.samples for block in self.blocks])

    async def lost(self, ask: Callable[[], Coroutine[Any, Any, object]]) -> float:
        """Seconds until ``ask``, repeated 25 times a second, says that the link is lost."""
        start_s = self.now_s
        while self.now_s - start_s < 2.0:
            try:
                await ask()
            except LinkLost:
                return self.now_s - start_s
            await asyncio.sleep(POLL_S)
        raise AssertionError("the loss was not noticed within 2 s")


def _done(state: DrumState) -> bool:
    result = state.values["command_result"]
    assert result != CommandResult.FAILED, f"failed: {Fault(state.fault).name}"
    return result == CommandResult.DONE
