"""What every engine does: tasks, clients, status and events, the disk, an orderly end.

A run continues without a client. Without client and work the engine makes the rig safe and ends.
"""

from __future__ import annotations

import asyncio
import math
import socket
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Coroutine, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar

from rigctl.config.rig_config import About, RecordingConfig, RunConfig
from rigctl.engine.copy_process import COPY, CopyProcess
from rigctl.engine.event_bus import EventBus
from rigctl.engine.event_hook import EventHook
from rigctl.engine.keep_awake import KeepAwake, not_kept_awake
from rigctl.engine.rpc.commands import RequestHandler
from rigctl.engine.rpc.messages import (
    DISK,
    NOTHING_RECORDED_S,
    STATUS_PERIOD_S,
    UNRECORDED,
    LslScope,
    engine_message,
)
from rigctl.engine.rpc.server import KEPT_EVENTS, Server
from rigctl.engine.served_run import ServedRun
from rigctl.engine.streams_process import StreamsProcess
from rigctl.engine.told_process import LslOutlet
from rigctl.errors import DiskFault, RigctlError, RigFault
from rigctl.session.extra_stream import STREAM_KIND
from rigctl.session.ground_truth import TruthRecorder
from rigctl.values import Event

IDLE_TIMEOUT_S = 10.0
"""Without client and run the engine ends after this time."""
EVENT_LETTERS = 500
"""Of the text of a past event, so that all of them fit into one message."""
LATE_S = 0.2
"""A loop that is later is told: with a poll's period, a drum waits no longer for its heartbeat."""
FREQUENT_EVENTS = ("batch", "prediction")
"""Kinds that the moving finger sends every 100 ms; none is kept."""


class ServedConfig(Protocol):
    """What every experiment's description of a rig says of its runs."""

    @property
    def about(self) -> About:
        """Names that every session stores."""

    @property
    def recording(self) -> RecordingConfig:
        """How sessions are recorded."""

    @property
    def run(self) -> RunConfig:
        """What happens while a run goes on."""


_Run = TypeVar("_Run", bound=ServedRun[Any, Any])
_Request = TypeVar("_Request")


class ServedEngine(ABC, Generic[_Run, _Request]):
    """The control program of one rig; :meth:`serve` runs it."""

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        description: str,
        truth: TruthRecorder,
        config: ServedConfig,
    ) -> None:
        self.event_bus = EventBus(loop.time, self._fail)
        self.run: _Run | None = None
        self.is_ready = False
        self.keep_awake: KeepAwake = not_kept_awake
        """How a run keeps the computer awake; by default it does not."""
        self.loop = loop
        self.event_hook = EventHook(config.run.on_event, partial(self._tell, "hook"))
        self.event_bus.subscribe(self.event_hook)
        self.lsl = LslOutlet(self._tell)
        """Streams the samples to other programs, where somebody has switched it on."""
        self._copy_to = config.recording.copy_to
        self._streams_wanted = config.recording.streams
        self._recorded_s = 0.0
        self._description, self._asks = description, config.about.ask
        self._truth = truth
        self._now_s = loop.time
        self._tasks: set[asyncio.Task[None]] = set()
        self._run_task: asyncio.Task[None] | None = None
        self._server = Server(self._report_failure, self._send_control)
        self._past_events: deque[Event] = deque(maxlen=KEPT_EVENTS)
        self._last_used_s = self._now_s()
        self._shutdown_requested = asyncio.Event()

    async def serve(
        self,
        listener: socket.socket,
        token: str,
        handle: RequestHandler,
        request: _Request | None = None,
        first: socket.socket | None = None,
    ) -> int:
        """Connect, serve clients until the engine ends, make the rig safe; return the exit code.

        Clients come to ``listener`` and show the ``token``; ``first`` has come already. ``handle``
        executes their commands; ``request`` is a run to start immediately.
        """
        self.event_bus.subscribe(self._send_event)
        await self._server.open(listener, token, self, handle, first)
        try:
            if not await self._connected():
                await self._close()
                return 0
            self.spawn(self._tick())
            if request is not None:
                self.start(request)
        except RigctlError as error:
            data = {"exit_code": error.exit_code}
            self._server.set_greeting(engine_message("failed", str(error), data))
            await self._close()
            return error.exit_code
        self.is_ready = True
        self._server.set_greeting(engine_message("ready", "", self._describe()))
        await self._shutdown_requested.wait()
        await self._close()
        return 0

    async def _connected(self) -> bool:
        """Connect the boards; return False where the engine is to end before they answer."""
        connecting = self.loop.create_task(self._connect())
        ending = self.loop.create_task(self._shutdown_requested.wait())
        await asyncio.wait((connecting, ending), return_when=asyncio.FIRST_COMPLETED)
        for task in (connecting, ending):
            task.cancel()
        await asyncio.wait((connecting, ending))
        if connecting.cancelled():
            return False
        connecting.result()
        return True

    def _describe(self) -> dict[str, Any]:
        """Return what each client learns of the rig when it connects."""
        return {"rig": self._description, "asks": self._asks}

    @abstractmethod
    def start(self, request: _Request) -> _Run:
        """Start a run. Raises where the request or the disk is at fault."""

    @abstractmethod
    def status(self) -> Any:
        """Return the status message."""

    @abstractmethod
    async def _connect(self) -> None:
        """Connect the boards. Raises RigFault."""

    @abstractmethod
    async def _make_safe(self) -> None:
        """Switch the rig off at the end of the engine."""

    def _disconnect(self) -> None:
        """Close the boards; an engine closes its own first."""
        self.lsl.switch(LslScope.OFF)
        self.event_hook.close()

    def _begin(self, run: _Run) -> _Run:
        """Let a run that :meth:`start` has opened run; return it."""
        self.run = run
        run.copy, run.streams = self._begin_beside(run.folder, run.start)
        self._run_task = self.spawn(self._execute(run))
        self.event_bus.publish("run", f"the run begins: {run.folder}", session=str(run.folder))
        return run

    def _begin_beside(
        self, folder: Path, start: tuple[str, float]
    ) -> tuple[CopyProcess | None, StreamsProcess | None]:
        """Start what copies a recording to a second disk, and what records streams beside it."""
        return self._begin_copy(folder), self._begin_streams(folder, start)

    def _begin_copy(self, folder: Path) -> CopyProcess | None:
        """Start what copies a session to a second disk, if there is one."""
        if not self._copy_to:
            return None
        try:
            return CopyProcess(folder, self._copy_to, self._tell)
        except OSError as error:
            text = f"no process copies {folder} to {self._copy_to} ({error.strerror})"
            self.event_bus.publish(COPY, f"{text}: run rigctl copy afterwards")
            return None

    def _begin_streams(self, folder: Path, start: tuple[str, float]) -> StreamsProcess | None:
        """Start what records the streams of other programs beside a sitting, if any are wanted."""
        if not self._streams_wanted:
            return None
        try:
            return StreamsProcess(folder, self._streams_wanted, start, self._tell)
        except OSError as error:
            text = f"no process records the streams of other programs ({error.strerror})"
            self.event_bus.publish(STREAM_KIND, text)
            return None

    async def _execute(self, run: _Run) -> None:
        await self._run(run)
        self._send_status()

    async def _run(self, run: _Run) -> None:
        """Let a run end; a simulated rig logs its truth beside it."""
        with self._publish_disk_fault():
            self._truth.begin(run.folder, run.start)
        try:
            with self.keep_awake(partial(self._tell, "awake")):
                await run.execute()
        finally:
            with self._publish_disk_fault():
                self._truth.end()

    @contextmanager
    def _publish_disk_fault(self) -> Iterator[None]:
        """Publish that the truth could not be written; the recorder judges the disk itself."""
        try:
            yield
        except DiskFault as fault:
            self.event_bus.publish("fault", str(fault))

    def _mark_link(self, reason: str, connected: bool) -> None:
        """Pause an active run for this reason while a device is not connected."""
        if self.run is None or self.run.ended:
            return
        if connected:
            self.run.control.resume(reason)
        else:
            self.run.control.pause(reason)

    @property
    def is_running(self) -> bool:
        """Whether a run is active, paused ones included."""
        return self.run is not None and not self.run.ended

    @property
    def is_needed(self) -> bool:
        """Whether there is work to do without a client."""
        return self.is_running

    def spawn(self, work: Coroutine[Any, Any, None]) -> asyncio.Task[None]:
        """Start a task; its failure ends the engine safely."""
        task = self.loop.create_task(self._supervise(work))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        return task

    def shut_down(self, text: str) -> None:
        """End the engine: abort a run first, then make the rig safe."""
        if self.run is not None:
            self.run.control.abort(text)
        self._shutdown_requested.set()

    def end_if_unused(self, text: str) -> bool:
        """End the engine where it has one client at most and no work; return whether it ends.

        A connection that only brings a STOP, as that of `rigctl stop` or of a window whose own
        connection does not get through, is no client.
        """
        is_unused = self._server.users <= 1 and not self.is_needed
        if is_unused:
            self.shut_down(text)
        return is_unused

    def past_events(self, count: int) -> list[dict[str, Any]]:
        """Return the newest ``count`` events with their ages in s, the oldest first."""
        now_s, events = self._now_s(), list(self._past_events)
        return [
            {"age_s": now_s - e.at_s, "kind": e.kind, "text": e.text[:EVENT_LETTERS]}
            for e in events[max(0, len(events) - count) :]
        ]

    async def _supervise(self, work: Coroutine[Any, Any, None]) -> None:
        try:
            await work
        except Exception as error:  # noqa: BLE001 - top of a task: it becomes a visible fault
            self._fail(error)

    def _fail(self, error: Exception) -> None:
        """Publish an internal error, and end the engine safely."""
        sentence = f"internal error of the engine: {error!r}; report it with the session"
        self.event_bus.publish("fault", sentence)
        self.shut_down(sentence)

    async def _tick(self) -> None:
        """Serve recorder and clients, and send the status, ten times a second."""
        while True:
            due_s = self._now_s() + STATUS_PERIOD_S
            await asyncio.sleep(STATUS_PERIOD_S)
            self._tell_late(self._now_s() - due_s)
            self._serve_boards()
            self._check_disk()
            self._check_recorded()
            self._check_idle()
            self._send_status()

    def _tell(self, kind: str, text: str, **data: Any) -> None:
        """Publish an event, from any thread."""
        self.loop.call_soon_threadsafe(partial(self.event_bus.publish, kind, text, **data))

    def _tell_late(self, late_s: float) -> None:
        """Publish that the loop itself stood still, and the boards went on without it."""
        if late_s > LATE_S:
            text = f"this computer was asleep or too busy for {late_s:,.1f} s"
            self.event_bus.publish("late", text, late_s=round(late_s, 3))

    def _serve_boards(self) -> None:
        """Do what boards and processes need ten times a second."""
        if self.run is not None and self.run.streams is not None:
            self.run.streams.tell_time(self._now_s())
        with self._publish_disk_fault():
            self._truth.save(self._now_s())

    def _check_disk(self) -> None:
        if self.run is None or self.run.ended:
            return
        monitor, control = self.run.disk_monitor, self.run.control
        monitor.update(self._now_s())
        if monitor.must_pause(DISK in control.reasons):
            control.pause(DISK)
        else:
            control.resume(DISK)

    def _check_recorded(self) -> None:
        """Tell once that a run which waits for nobody has got no samples for long."""
        run, now_s = self.run, self._now_s()
        if run is None or run.state != "running" or self._is_recorded(run):
            self._recorded_s = now_s
        elif now_s - self._recorded_s > NOTHING_RECORDED_S:
            text = f"no sample was recorded for {NOTHING_RECORDED_S:.0f} s: look at the rig"
            self.event_bus.publish(UNRECORDED, text)
            self._recorded_s = math.inf

    @abstractmethod
    def _is_recorded(self, run: _Run) -> bool:
        """Return whether samples of a run have reached the disk within the last second."""

    def _check_idle(self) -> None:
        now_s = self._now_s()
        if self.is_needed or len(self._server):
            self._last_used_s = now_s
        elif now_s - self._last_used_s > IDLE_TIMEOUT_S:
            self.shut_down("no client is left")

    def _send_status(self) -> None:
        if len(self._server):
            message = engine_message("status", "", self.status(), self._now_s())
            self._server.broadcast_status(message)

    def _report_failure(self, sentence: str) -> None:
        """Publish that a request failed inside the engine, which goes on."""
        self.event_bus.publish("fault", sentence)

    def _send_control(self, text: str) -> None:
        """Tell every client who has control. It is no event of the session."""
        state = asdict(self._server.control.state)
        self._send_event(Event(self._now_s(), "control", text, state))

    def _send_event(self, event: Event) -> None:
        if event.text and event.kind not in FREQUENT_EVENTS:
            self._past_events.append(event)
        self._server.broadcast(engine_message(event.kind, event.text, event.data, event.at_s))

    def _fail_run(self, fault: RigFault) -> None:
        if self.run is not None:
            self.run.control.fail(fault)

    async def _close(self) -> None:
        """Wait for a run's safe end, switch the rig off, close boards and connections."""
        if self.run is not None and self._run_task is not None:
            self.run.control.abort("the engine ends")
            await self._run_task
        try:
            await self._make_safe()
        except RigFault as fault:
            self.event_bus.publish("fault", str(fault))
        for task in tuple(self._tasks):
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        self._disconnect()
        await self._server.close()
