"""The engine: both boards, sample pipeline, recorder and runner in one event loop.

A run continues without a client. Without client and run the engine makes the rig safe and ends.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from functools import partial
from typing import Any

from rigctl.acquisition.boards import Boards
from rigctl.acquisition.event_bus import EventBus
from rigctl.acquisition.health.heartbeat import HeartbeatGate
from rigctl.acquisition.live_buffer import LiveWriter
from rigctl.acquisition.protocol.run_reasons import DISK, LINK
from rigctl.acquisition.protocol.run_request import RunContext, RunRequest, open_run
from rigctl.acquisition.protocol.runner import Run
from rigctl.acquisition.rig import Rig
from rigctl.acquisition.rpc.messages import (
    STATUS_PERIOD_S,
    EngineStatus,
    RecordingStatus,
    RunStatus,
)
from rigctl.acquisition.rpc.server import EngineAddress, RequestHandler, Server
from rigctl.acquisition.status import StatusBuilder
from rigctl.acquisition.taxels.pipeline import FAST_BATCH_SAMPLES, REAL_TIME_BATCH_SAMPLES
from rigctl.errors import RigctlError, RigFault
from rigctl.values import Event

IDLE_TIMEOUT_S = 10.0
"""Without client and run the engine ends after this time."""


class Engine:
    """The control program of one rig; :meth:`serve` runs it.

    ``real_time``: loop time is as fast as real time, so that people can watch.
    """

    def __init__(
        self, rig: Rig, live_writer: LiveWriter, utc_now: Callable[[], str], real_time: bool = True
    ) -> None:
        self.rig = rig
        self.event_bus = EventBus(rig.loop.time)
        self.heartbeat_gate = HeartbeatGate(rig.loop.time)
        self.boards = Boards(
            rig,
            live_writer,
            self.event_bus,
            self.spawn,
            self.heartbeat_gate.is_open,
            self._taxel_link_changed,
            self._fail_run,
            REAL_TIME_BATCH_SAMPLES if real_time else FAST_BATCH_SAMPLES,
        )
        self.run: Run | None = None
        self.is_ready = False
        self._now_s = rig.loop.time
        self._utc_now = utc_now
        self._texture: str | None = None
        self._status_builder = StatusBuilder(rig, self.boards)
        self._tasks: set[asyncio.Task[None]] = set()
        self._run_task: asyncio.Task[None] | None = None
        self._server = Server()
        self._last_used_s = self._now_s()
        self._shutdown_requested = asyncio.Event()

    async def serve(
        self, address: EngineAddress, handle: RequestHandler, request: RunRequest | None = None
    ) -> int:
        """Connect, serve clients until the engine ends, make the rig safe; return the exit code.

        ``handle`` executes the clients' commands; ``request`` is a run to start immediately.
        """
        self.event_bus.subscribe(self._send_event)
        await self._server.open(address, handle)
        try:
            await self.boards.connect()
            self.spawn(self._tick())
            if request is not None:
                self.start(request)
        except RigctlError as error:
            failed = _message("failed", str(error), {"exit_code": error.exit_code})
            self._server.set_greeting(failed)
            await self._close()
            return error.exit_code
        self.is_ready = True
        self._server.set_greeting(_message("ready", "", {"rig": self.rig.description}))
        await self._shutdown_requested.wait()
        await self._close()
        return 0

    def start(self, request: RunRequest) -> Run:
        """Start a run. Raises where the request or the disk is at fault."""
        identities = tuple(self.boards.identities.values())
        context = RunContext(self.rig, identities, self._utc_now())
        check_in = partial(self.heartbeat_gate.check_in, "runner")
        opened = open_run(request, context)
        self.run = Run(self.boards, self.event_bus, opened, check_in, self.set_plate)
        self._run_task = self.spawn(self._execute(self.run))
        folder = str(self.run.folder)
        self.event_bus.publish("run", f"the run begins: {folder}", session=folder)
        return self.run

    @property
    def is_running(self) -> bool:
        """Whether a run is active, paused ones included."""
        return self.run is not None and not self.run.ended

    def set_plate(self, texture: str) -> bool:
        """Store which plate is mounted; return whether a simulated rig mounted it."""
        self._texture = texture
        return self.rig.set_plate(texture)

    def status(self) -> EngineStatus:
        """Return the status message."""
        recording, run = RecordingStatus(), RunStatus()
        if self.run is not None:
            recording = self.run.disk_monitor.status(self.boards.pipeline.is_recording)
            run = self.run.status()
        return self._status_builder.build(self._now_s(), self._texture, recording, run)

    def spawn(self, work: Coroutine[Any, Any, None]) -> asyncio.Task[None]:
        """Start a task; its failure ends the engine safely."""
        task = self.rig.loop.create_task(self._supervise(work))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        return task

    async def send_stop(self, text: str) -> None:
        """Stop and lift, ahead of everything else; a run ends."""
        if self.run is not None:
            self.run.control.abort(text)
        self.boards.motion.stop_count += 1
        await self.rig.drum.stop()
        self.event_bus.publish("stop", text)

    def shut_down(self, text: str) -> None:
        """End the engine: abort a run first, then make the rig safe."""
        if self.run is not None:
            self.run.control.abort(text)
        self._shutdown_requested.set()

    async def _execute(self, run: Run) -> None:
        self.heartbeat_gate.check_in("runner")
        try:
            await run.execute()
        finally:
            self.heartbeat_gate.check_out("runner")
            self.heartbeat_gate.check_out("recorder")
        self.rig.save_truth(run.folder)
        self._send_status()

    async def _supervise(self, work: Coroutine[Any, Any, None]) -> None:
        try:
            await work
        except Exception as error:  # noqa: BLE001 - top of a task: it becomes a visible fault
            sentence = f"internal error of the engine: {error!r}; report it with the session"
            self.event_bus.publish("fault", sentence)
            self.shut_down(sentence)

    async def _tick(self) -> None:
        """Serve pipeline, recorder and clients, and send the status, ten times a second."""
        while True:
            await asyncio.sleep(STATUS_PERIOD_S)
            self.boards.pipeline.flush()
            self.heartbeat_gate.check_in("pipeline")
            self._check_disk()
            self._check_idle()
            self._send_status()

    def _check_disk(self) -> None:
        if self.run is None or self.run.ended:
            return
        monitor, control = self.run.disk_monitor, self.run.control
        monitor.update(self._now_s())
        if monitor.recorder_works:
            self.heartbeat_gate.check_in("recorder")
        if monitor.must_pause(DISK in control.reasons):
            control.pause(DISK)
        else:
            control.resume(DISK)

    def _check_idle(self) -> None:
        now_s = self._now_s()
        if self.is_running or len(self._server):
            self._last_used_s = now_s
        elif now_s - self._last_used_s > IDLE_TIMEOUT_S:
            self.shut_down("no client is left")

    def _send_status(self) -> None:
        if len(self._server):
            self._server.broadcast(_message("status", "", self.status(), self._now_s()))

    def _send_event(self, event: Event) -> None:
        self._server.broadcast(_message(event.kind, event.text, event.data, event.at_s))

    def _taxel_link_changed(self, connected: bool) -> None:
        if self.run is not None and connected:
            self.run.control.resume(LINK)
        elif self.run is not None and not self.run.ended:
            self.run.control.pause(LINK)

    def _fail_run(self, fault: RigFault) -> None:
        if self.run is not None:
            self.run.control.fail(fault)

    async def _close(self) -> None:
        """Wait for a run's safe end, switch the rig off, close boards and connections."""
        if self.run is not None and self._run_task is not None:
            self.run.control.abort("the engine ends")
            await self._run_task
        try:
            if self.boards.drum_poller.connected and self.boards.drum_poller.state is not None:
                await self.boards.motion.disarm()
        except RigFault as fault:
            self.event_bus.publish("fault", str(fault))
        for task in tuple(self._tasks):
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        self.rig.drum.close()
        self.rig.taxels.close()
        await self._server.close()


def _message(kind: str, text: str, data: object, at_s: float = 0.0) -> dict[str, Any]:
    return {"event": kind, "at_s": at_s, "text": text, "data": data}
