"""The engine: both boards, pump, recorder, encoder and runner in one loop that does nothing else.

It is born with a rig and often with a first client, connects the boards, and from then on does
what clients ask (:mod:`rigctl.acquisition.rpc.command_handler`). A client may die at any time;
a run goes on without one. Without client and run the engine makes the rig safe and ends.
"""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Callable, Coroutine
from dataclasses import dataclass
from typing import Any

from rigctl.acquisition.boards import Boards
from rigctl.acquisition.event_bus import EventBus
from rigctl.acquisition.health.disk import DiskMonitor
from rigctl.acquisition.health.heartbeat import HeartbeatGate
from rigctl.acquisition.live_buffer import LiveWriter
from rigctl.acquisition.protocol.run_control import DISK, LINK, RunControl
from rigctl.acquisition.protocol.run_request import RunContext, RunRequest, open_run
from rigctl.acquisition.protocol.runner import Run
from rigctl.acquisition.protocol.step_runner import RunOptions, RunParts
from rigctl.acquisition.rig_interface import RigInterface
from rigctl.acquisition.rpc.messages import (
    STATUS_PERIOD_S,
    EngineStatus,
    RecordingStatus,
    RunStatus,
)
from rigctl.acquisition.rpc.server import Handler, Server
from rigctl.acquisition.status import StatusBuilder
from rigctl.acquisition.taxels.pipeline import UNWATCHED_SAMPLES, WATCHED_SAMPLES
from rigctl.errors import RigctlError, RigFault
from rigctl.values import Event

ALONE_LIMIT_S = 10.0
"""Without client and run the engine ends after so long."""


@dataclass(frozen=True, slots=True)
class EngineAddress:
    """How clients reach the engine: a listening socket, its token, and who is there already."""

    listener: socket.socket
    token: str
    first: socket.socket | None = None


class Engine:
    """Everything that happens on one rig. :meth:`serve` is its life.

    ``watched``: loop time goes as fast as ours, so that people can watch.
    """

    def __init__(
        self,
        bench: RigInterface,
        live: LiveWriter,
        utc_now: Callable[[], str],
        rig_seed: int = 0,
        watched: bool = True,
    ) -> None:
        self.bench = bench
        self.news = EventBus(bench.loop.time)
        self.vitals = HeartbeatGate(bench.loop.time)
        self.boards = Boards(
            bench,
            live,
            self.news,
            self.vitals.may_beat,
            self._taxels_changed,
            self._fail_run,
            WATCHED_SAMPLES if watched else UNWATCHED_SAMPLES,
        )
        self.run: Run | None = None
        self.is_ready = False
        self._now_s = bench.loop.time
        self._utc_now = utc_now
        self._rig_seed = rig_seed
        self._texture: str | None = None
        self._status = StatusBuilder(bench.kind, bench.simulated, self.boards)
        self._guard: DiskMonitor | None = None
        self._tasks: set[asyncio.Task[None]] = set()
        self._run_task: asyncio.Task[None] | None = None
        self._server: Server | None = None
        self._alone_since_s = self._now_s()
        self._ended = asyncio.Event()

    async def serve(
        self, doors: EngineAddress, handle: Handler, order: RunRequest | None = None
    ) -> int:
        """Connect, serve clients until the engine ends, make the rig safe; return the exit code.

        ``handle`` executes the clients' commands.
        """
        self._server = Server(doors.token, handle)
        self.news.listen(self._tell_clients)
        await self._server.open(doors.listener, doors.first)
        try:
            await self.boards.connect(self.spawn)
            self.spawn(self._tick())
            if order is not None:
                self.start(order)
        except RigctlError as error:
            self._server.welcome(_message("failed", str(error), {"exit_code": error.exit_code}))
            await self._leave()
            return error.exit_code
        self.is_ready = True
        self._server.welcome(_message("ready", "", {"rig": self.bench.description}))
        await self._ended.wait()
        await self._leave()
        return 0

    def start(self, order: RunRequest) -> Run:
        """Begin a run. Raises what is wrong with the order or the disk."""
        opened = open_run(order, self._bearings())
        recorder, boards = opened.recorder, self.boards
        control = RunControl(
            boards.watch,
            self.news,
            lambda: self.vitals.check_in("runner"),
            lambda: recorder.failure,
        )
        parts = RunParts(
            boards.motion, boards.pump, self.news, recorder, control, boards.health, self.set_plate
        )
        unasked = order.yes and self.bench.simulated
        options = RunOptions(unasked, opened.resumed, opened.done, opened.attempts)
        self._guard = DiskMonitor(recorder)
        self.run = Run(parts, opened.plan, options)
        self._run_task = self.spawn(self._execute(self.run))
        self.news.tell("run", f"the run begins: {self.run.folder}", session=str(self.run.folder))
        return self.run

    @property
    def is_running(self) -> bool:
        """Whether a run is going, paused ones included."""
        return self.run is not None and not self.run.ended

    def set_plate(self, texture: str) -> bool:
        """A plate is changed: True where it did so by itself."""
        self._texture = texture
        return self.bench.set_plate(texture)

    def status(self) -> EngineStatus:
        """How everything stands now."""
        recording = RecordingStatus()
        if self._guard is not None:
            recording = self._guard.status(self.boards.pump.recording)
        run = self.run.status() if self.run else RunStatus()
        return self._status.build(self._now_s(), self._texture, recording, run)

    def spawn(self, work: Coroutine[Any, Any, None]) -> asyncio.Task[None]:
        """Have something done beside everything else; its failure ends the engine safely."""
        task = self.bench.loop.create_task(self._guarded(work))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        return task

    async def stop(self, text: str) -> None:
        """Stop and lift, ahead of everything else; a run ends."""
        if self.run is not None:
            self.run.control.abort(text)
        self.boards.motion.stops += 1
        await self.bench.drum.stop()
        self.news.tell("stop", text)

    def end(self, text: str) -> None:
        """End the engine: a run is aborted first, and the rig made safe."""
        if self.run is not None:
            self.run.control.abort(text)
        self._ended.set()

    async def _execute(self, run: Run) -> None:
        self.vitals.check_in("runner")
        try:
            await run.execute()
        finally:
            self.vitals.excuse("runner")
            self.vitals.excuse("recorder")
        self.bench.save_truth(run.folder)
        self._tell_status()

    async def _guarded(self, work: Coroutine[Any, Any, None]) -> None:
        try:
            await work
        except Exception as error:  # noqa: BLE001 - top of a task: it becomes a visible fault
            sentence = f"the engine failed inside: {error!r}; report this with the session"
            self.news.tell("fault", sentence)
            self.end(sentence)

    async def _tick(self) -> None:
        """Ten times a second: look after pump, recorder and clients, and tell the status."""
        while True:
            await asyncio.sleep(STATUS_PERIOD_S)
            self.boards.pump.flush()
            self.vitals.check_in("pump")
            self._look_after_disk()
            self._look_if_alone()
            self._tell_status()

    def _tell_status(self) -> None:
        if self._server is not None and len(self._server):
            self._server.broadcast(_message("status", "", self.status(), self._now_s()))

    def _look_after_disk(self) -> None:
        if self._guard is None or self.run is None or self.run.ended:
            return
        self._guard.look(self._now_s())
        if self._guard.works:
            self.vitals.check_in("recorder")
        control = self.run.control
        if self._guard.must_hold(DISK in control.reasons):
            control.pause(DISK)
        else:
            control.resume(DISK)

    def _look_if_alone(self) -> None:
        now_s = self._now_s()
        if self.is_running or (self._server is not None and len(self._server)):
            self._alone_since_s = now_s
        elif now_s - self._alone_since_s > ALONE_LIMIT_S:
            self.end("nobody is left")

    def _taxels_changed(self, connected: bool) -> None:
        if self.run is not None and connected:
            self.run.control.resume(LINK)
        elif self.run is not None and not self.run.ended:
            self.run.control.pause(LINK)

    def _fail_run(self, fault: RigFault) -> None:
        if self.run is not None:
            self.run.control.fail(fault)

    def _tell_clients(self, event: Event) -> None:
        if self._server is not None:
            self._server.broadcast(_message(event.kind, event.text, event.data, event.at_s))

    def _bearings(self) -> RunContext:
        return RunContext(
            config=self.bench.config,
            rig=self.bench.kind,
            simulated=self.bench.simulated,
            world=self.bench.world,
            rig_seed=self._rig_seed,
            boards=tuple(self.boards.identities.values()),
            start_utc=self._utc_now(),
            start_loop_s=self._now_s(),
        )

    async def _leave(self) -> None:
        """See a run to its safe end, switch the rig off, let go of everything."""
        if self.run is not None and self._run_task is not None:
            self.run.control.abort("the engine ends")
            await self._run_task
        try:
            if self.boards.watch.connected and self.boards.watch.state is not None:
                await self.boards.motion.disarm()
        except RigFault as fault:
            self.news.tell("fault", str(fault))
        for task in tuple(self._tasks):
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        self.boards.close()
        assert self._server is not None
        await self._server.close()


def _message(kind: str, text: str, data: object, at_s: float = 0.0) -> dict[str, Any]:
    return {"event": kind, "at_s": at_s, "text": text, "data": data}
