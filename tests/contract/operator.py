"""A scripted operator: polls with the heartbeat, changes states, records states and samples."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from rigctl.bench.parameters import WorldParameters
from rigctl.boards.drum_codes import Command, CommandResult, Status
from rigctl.boards.drum_states import Fault, State
from rigctl.engine.rig import Rig
from rigctl.errors import LinkLost, RigFault
from rigctl.values import Block, DrumState

Result = TypeVar("Result")
POLL_S = 0.04
NOMINAL = WorldParameters()
NEXT_COMMAND = {
    State.IDLE: Command.ARM,
    State.ARMED: Command.APPROACH,
    State.HOLD: Command.RUN,
}
"""The command that leads from a state towards contact."""


class Operator:
    """The operator of one simulated rig. World time passes inside :meth:`run` only."""

    def __init__(self, rig: Rig) -> None:
        assert rig.simulation is not None
        assert rig.faults is not None
        self.rig, self.drum, self.taxels = rig, rig.drum, rig.taxels
        self.simulation, self.faults = rig.simulation, rig.faults
        self.clocks_ppm = {"drum": NOMINAL.drum_clock_ppm, "taxels": NOMINAL.taxel_clock_ppm}
        self.states: list[DrumState] = []
        self.blocks: list[Block] = []
        self.taxel_faults: list[RigFault] = []
        rig.taxels.on_block(self.blocks.append)
        rig.taxels.on_fault(self.taxel_faults.append)

    def run(self, work: Coroutine[Any, Any, Result]) -> Result:
        """Run ``work`` in the rig's loop."""
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

    async def poll(self, heartbeat: bool = True) -> DrumState:
        """Poll the drum and record its state."""
        state = await self.drum.poll(heartbeat)
        self.states.append(state)
        return state

    def shows(self, status: Status) -> bool:
        """Return a status bit of the newest poll."""
        return bool(self.states[-1].status_bits >> status & 1)

    def clear_record(self) -> None:
        """Begin a new record."""
        self.states.clear()
        self.blocks.clear()
        self.taxel_faults.clear()

    async def connect(self) -> None:
        """Connect both boards."""
        await self.drum.connect()
        await self.taxels.connect()
        await self.poll()

    async def until(
        self, done: Callable[[DrumState], bool], limit_s: float = 15.0, beat: bool = True
    ) -> DrumState:
        """Poll 25 times a second until a state is ``done``."""
        end_s = self.now_s + limit_s
        while self.now_s < end_s:
            state = await self.poll(beat)
            if done(state):
                return state
            await asyncio.sleep(POLL_S)
        raise AssertionError(f"not done within {limit_s} s: {self.state.name}, {self.fault.name}")

    async def watch(self, seconds: float, beat: bool = True) -> None:
        """Poll for this time."""
        end_s = self.now_s + seconds
        await self.until(lambda state: self.now_s >= end_s, seconds + 1, beat)

    async def until_state(self, state: State, limit_s: float = 15.0) -> DrumState:
        """Poll until the drum is in ``state``."""
        return await self.until(lambda now: now.state == state, limit_s)

    async def reach(self, goal: State) -> None:
        """Go from any state to IDLE, ARMED, HOLD or RUN."""
        await self._make_sound()
        if State(self.states[-1].state) not in (State.IDLE, goal):
            await self.drum.stop()
            await self.until(lambda s: s.state in (State.ARMED, State.IDLE))
        if goal is State.IDLE and self.state is not State.IDLE:
            await self.do(Command.DISARM)
        while self.state is not goal:
            if self.state in (State.IDLE, State.ARMED) and not self.shows(Status.COMMISSIONED):
                await self.do(Command.COMMISSION)
            if self.state is State.ARMED and not self.shows(Status.TARED):
                await self.do(Command.TARE)
            command = NEXT_COMMAND[self.state]
            await self.drum.command(command)
            await self.until(lambda s, c=command: s.state == goal or _done(s))

    async def do(self, command: Command, limit_s: float = 15.0) -> DrumState:
        """Give a command and poll until it is done."""
        await self.drum.command(command)
        return await self.until(_done, limit_s)

    async def _make_sound(self) -> None:
        """Reconnect and clear a latched fault where necessary."""
        if not self.taxels.connected:
            await self.taxels.connect()
        if not self.drum.connected:
            await self.drum.connect()
        state = await self.poll()
        if state.fault:
            await self.until_state(State.FAULT_OFF)
            await self.do(Command.CLEAR)

    @property
    def counters(self) -> NDArray[np.int64]:
        """Counters of all received samples."""
        return np.concatenate([block.counters for block in self.blocks])

    @property
    def flags(self) -> NDArray[np.uint8]:
        """Flags of all received samples."""
        return np.concatenate([block.flags for block in self.blocks])

    @property
    def edges(self) -> NDArray[np.uint8]:
        """Edge counts of all received samples."""
        return np.concatenate([block.edges for block in self.blocks])

    @property
    def samples(self) -> NDArray[np.uint16]:
        """Readings of all received samples."""
        return np.concatenate([block.samples for block in self.blocks])

    async def lost(self, ask: Callable[[], Coroutine[Any, Any, object]]) -> float:
        """Return the seconds until ``request``, repeated 25 times a second, reports a lost link."""
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
