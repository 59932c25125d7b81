"""The one who polls the drum: 20 times a second, with the heartbeat, until the engine ends.

Everybody who waits for the drum waits here, for the next turn of the poll loop. A turn comes
every 50 ms whether the board answers or not, so a waiter always learns of a fault or of a lost
link, and can be called off.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from rigctl.acquisition.rig_interface import DrumBoard
from rigctl.acquisition.taxels.clock_fit import ClockFit
from rigctl.errors import BoardFault, LinkLost, RigFault
from rigctl.values import BoardIdentity, DrumState
from rigctl.wire.drum.codes import CommandResult
from rigctl.wire.drum.states import FAULT_TEXT, Fault, State

POLL_PERIOD_S = 0.05
RECONNECT_PERIOD_S = 0.5
FAULT_STATES = (State.FAULT_LIFT, State.FAULT_OFF)


class DrumPoller:
    """Polls the drum, keeps its newest state, follows its clock, and reconnects.

    ``may_beat`` is asked before each poll. ``on_lost(reason)`` is told of a loss,
    ``on_back(identity, rebooted)`` of a return.
    """

    def __init__(
        self,
        drum: DrumBoard,
        loop: asyncio.AbstractEventLoop,
        may_beat: Callable[[], bool],
        on_lost: Callable[[str], None],
        on_back: Callable[[BoardIdentity, bool], None],
    ) -> None:
        self.drum = drum
        self.loop = loop
        self.clock = ClockFit()
        self.state: DrumState | None = None
        self.identity: BoardIdentity | None = None
        self.lost = "not connected yet"
        self._may_beat = may_beat
        self._on_lost = on_lost
        self._on_back = on_back
        self._watchers: list[Callable[[DrumState], None]] = []
        self._waiters: list[asyncio.Future[None]] = []

    @property
    def connected(self) -> bool:
        """Whether the drum answers."""
        return not self.lost

    @property
    def fault_latched(self) -> bool:
        """Whether the newest state shows a fault."""
        state = self.state
        return state is not None and bool(state.fault or state.state in FAULT_STATES)

    async def connect(self) -> BoardIdentity:
        """First connection. Raises LinkLost or WrongBoard."""
        self.identity = await self.drum.connect()
        self.lost = ""
        return self.identity

    def watch(self, watcher: Callable[[DrumState], None]) -> Callable[[], None]:
        """Show every new state to ``watcher``; the answer ends that."""
        self._watchers.append(watcher)
        return lambda: self._watchers.remove(watcher)

    async def run(self) -> None:
        """Poll until cancelled; the period holds on average, and missed turns are left out."""
        due_s = self.loop.time()
        while True:
            await self._turn()
            period_s = POLL_PERIOD_S if self.connected else RECONNECT_PERIOD_S
            due_s = max(due_s + period_s, self.loop.time())
            await asyncio.sleep(due_s - self.loop.time())

    async def turn(self) -> None:
        """Wait for the end of the next turn of the poll loop."""
        waiter: asyncio.Future[None] = self.loop.create_future()
        self._waiters.append(waiter)
        await waiter

    async def until(
        self,
        done: Callable[[DrumState], bool],
        limit_s: float,
        what: str,
        check: Callable[[], None] = lambda: None,
    ) -> DrumState:
        """Wait until a new state is ``done``; ``check`` may raise at every turn.

        Raises LinkLost, BoardFault when the drum latched a fault, RigFault after ``limit_s``.
        """
        end_s = self.loop.time() + limit_s
        while True:
            await self.turn()
            check()
            state = self.healthy()
            if done(state):
                return state
            if self.loop.time() > end_s:
                raise RigFault(f"{what} took longer than {limit_s:g} s: the run stops here")

    def healthy(self) -> DrumState:
        """The newest state. Raises LinkLost without one, BoardFault where a fault is latched."""
        if self.lost or self.state is None:
            raise LinkLost(self.lost or "drum: it was not polled yet")
        if self.fault_latched:
            raise BoardFault(FAULT_TEXT[Fault(self.state.fault)])
        return self.state

    async def _turn(self) -> None:
        try:
            if self.lost:
                await self._reconnect()
            else:
                await self._poll()
        except LinkLost as loss:
            self._lose(str(loss))
        waiters, self._waiters = self._waiters, []
        for waiter in waiters:
            if not waiter.done():
                waiter.set_result(None)

    async def _poll(self) -> None:
        state = await self.drum.poll(beat=self._may_beat())
        self.clock.add(state.board_time_us / 1e6, state.at_s)
        self.state = state
        for watcher in tuple(self._watchers):
            watcher(state)

    async def _reconnect(self) -> None:
        before = self.identity
        try:
            self.identity = await self.drum.connect()
        except RigFault as refusal:
            raise LinkLost(str(refusal)) from refusal
        rebooted = before is None or before.boot_count != self.identity.boot_count
        if rebooted:
            self.clock.restart()
        self.lost = ""
        self._on_back(self.identity, rebooted)

    def _lose(self, reason: str) -> None:
        news = not self.lost
        self.lost = reason
        if news:
            self._on_lost(reason)


def command_ended(state: DrumState) -> bool:
    """Whether the last command's work is over."""
    return state.values["command_result"] != CommandResult.RUNNING
