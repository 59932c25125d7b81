"""The poll loop of the drum: 20 polls a second, with the heartbeat, until the engine ends.

All code that waits for the drum waits for the next cycle of this loop. A cycle takes 50 ms, half a
second while the link is lost, so every wait notices a fault or a lost link and can be cancelled.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from rigctl.boards.clock_fit import ClockFit
from rigctl.boards.drum import Drum
from rigctl.boards.drum_states import FAULT_TEXT, Fault, State
from rigctl.errors import BoardFault, LinkLost, RigFault
from rigctl.values import BoardIdentity, DrumState

POLL_PERIOD_S = 0.05
RECONNECT_PERIOD_S = 0.5
NOT_POLLED = "the drum is not polled any more: start rigctl again"
FAULT_STATES = (State.FAULT_LIFT, State.FAULT_OFF)


class DrumPoller:
    """Polls the drum, stores its newest state, fits its clock, and reconnects.

    ``allows_heartbeat`` decides before each poll whether it carries the heartbeat.
    ``on_lost(reason)`` is called when the link is lost, ``on_reconnected(identity, rebooted)``
    when it is back.
    """

    def __init__(
        self,
        drum: Drum,
        loop: asyncio.AbstractEventLoop,
        allows_heartbeat: Callable[[], bool] = lambda: True,
        on_lost: Callable[[str], None] = lambda reason: None,
        on_reconnected: Callable[[BoardIdentity, bool], None] = lambda identity, rebooted: None,
    ) -> None:
        self.drum = drum
        self.loop = loop
        self.clock_fit = ClockFit()
        self.state: DrumState | None = None
        self.identity: BoardIdentity | None = None
        self.link_error = "not connected yet"
        self._has_ended = False
        self._allows_heartbeat = allows_heartbeat
        self._on_lost = on_lost
        self._on_reconnected = on_reconnected
        self._subscribers: list[Callable[[DrumState], None]] = []
        self._waiters: list[asyncio.Future[None]] = []

    @property
    def connected(self) -> bool:
        """Whether the drum answers."""
        return not self.link_error

    @property
    def fault_latched(self) -> bool:
        """Whether the newest state shows a fault."""
        state = self.state
        return state is not None and bool(state.fault or state.state in FAULT_STATES)

    @property
    def only_missed_beats(self) -> bool:
        """Whether the drum stopped because it heard no heartbeat, and for nothing else since."""
        return self.state is not None and self.state.fault == Fault.HEARTBEAT

    async def connect(self) -> BoardIdentity:
        """Connect and return the identity. Raises LinkLost or WrongBoard."""
        self.identity = await self.drum.connect()
        self.link_error = ""
        return self.identity

    def subscribe(self, subscriber: Callable[[DrumState], None]) -> Callable[[], None]:
        """Call ``subscriber`` with every new state; return the function that unsubscribes it."""
        self._subscribers.append(subscriber)
        return lambda: self._subscribers.remove(subscriber)

    async def run(self) -> None:
        """Poll until cancelled; the mean period is exact, and missed cycles are skipped.

        Nobody waits for a loop that a failed subscriber has ended.
        """
        due_s = self.loop.time()
        try:
            while True:
                await self._run_cycle()
                period_s = POLL_PERIOD_S if self.connected else RECONNECT_PERIOD_S
                due_s = max(due_s + period_s, self.loop.time())
                await asyncio.sleep(due_s - self.loop.time())
        except Exception:  # top of a task, which reports it; a run must not wait for ever
            self._has_ended, self.link_error = True, NOT_POLLED
            self._wake()
            raise

    async def wait_cycle(self) -> None:
        """Wait for the end of the next cycle of the poll loop. Raises LinkLost after its last."""
        if self._has_ended:
            raise LinkLost(NOT_POLLED)
        waiter: asyncio.Future[None] = self.loop.create_future()
        self._waiters.append(waiter)
        await waiter

    async def wait_until(
        self,
        is_done: Callable[[DrumState], bool],
        timeout_s: float,
        action: str,
        check: Callable[[], None] = lambda: None,
    ) -> DrumState:
        """Return the first new state that ``is_done``; ``check`` may raise at every cycle.

        Raises LinkLost, BoardFault when the drum latched a fault, and RigFault after ``timeout_s``
        with a sentence that begins with ``action``.
        """
        end_s = self.loop.time() + timeout_s
        while True:
            await self.wait_cycle()
            check()
            state = self.healthy_state()
            if is_done(state):
                return state
            if self.loop.time() > end_s:
                raise RigFault(f"{action} took longer than {timeout_s:g} s: check the drum")

    def healthy_state(self) -> DrumState:
        """Return the newest state. Raises LinkLost without one, BoardFault at a latched fault."""
        if self.link_error or self.state is None:
            raise LinkLost(self.link_error or "the drum has not been polled yet")
        if self.fault_latched:
            raise BoardFault(FAULT_TEXT[Fault(self.state.fault)])
        return self.state

    async def _run_cycle(self) -> None:
        try:
            if self.link_error:
                await self._reconnect()
            else:
                await self._poll()
        except LinkLost as loss:
            self._set_lost(str(loss))
        self._wake()

    def _wake(self) -> None:
        waiters, self._waiters = self._waiters, []
        for waiter in waiters:
            if not waiter.done():
                waiter.set_result(None)

    async def _poll(self) -> None:
        state = await self.drum.poll(heartbeat=self._allows_heartbeat())
        self.clock_fit.add(state.board_time_us / 1e6, state.at_s)
        self.state = state
        for subscriber in tuple(self._subscribers):
            subscriber(state)

    async def _reconnect(self) -> None:
        if self.drum.silence.is_on:
            raise LinkLost(self.drum.silence.text)  # the cycles go on meanwhile
        try:
            identity = await self.connect()
        except RigFault as refusal:
            raise LinkLost(str(refusal)) from refusal
        if self.drum.rebooted:
            self.clock_fit.reset()
        self._on_reconnected(identity, self.drum.rebooted)

    def _set_lost(self, reason: str) -> None:
        was_connected = self.connected
        self.link_error = reason
        if was_connected:
            self._on_lost(reason)
