"""The window's line to the engine: opened in a thread of its own, polled by the window's timer.

Nothing here waits for the engine. Requests go out at once, their answers come back through
:meth:`EngineLink.poll`, and an engine that says nothing is reported instead of waited for.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from typing import Any, Protocol

from PySide6.QtCore import QElapsedTimer, QObject, Signal

from rigctl.acquisition.live_buffer import LiveView
from rigctl.acquisition.rpc.client import EngineClient
from rigctl.acquisition.rpc.engine_files import EngineFile, running_engines, runtime_folder
from rigctl.acquisition.rpc.messages import EngineStatus, parse_status
from rigctl.errors import RigctlError

JOIN = "join"
SIMULATED = ("virtual", "firmware")
SILENCE_LIMIT_S = 1.5
STOP_LIMIT_S = 0.5


class Client(Protocol):
    """What the window needs of :class:`rigctl.acquisition.rpc.client.EngineClient`."""

    @property
    def announcement(self) -> EngineFile: ...

    @property
    def live(self) -> LiveView: ...

    def send(self, command: str, **args: Any) -> int: ...

    def drain(self) -> list[dict[str, Any]]: ...

    def close(self) -> None: ...

    def shut_down(self, limit_s: float = 30.0) -> int | None: ...


Opener = Callable[[str, str], Client]


def open_engine(rig: str, world: str = "") -> Client:
    """Start an engine, or join one; raises what kept it from opening.

    ``JOIN`` joins the newest that runs. A bench has one engine: where one has it already, that
    one is joined. Simulated rigs are as many as one likes, each with the ``world`` of a file.
    """
    if rig == JOIN:
        return EngineClient.attach()
    if world:
        return EngineClient.start(rig, run=["--world", world])
    if rig not in SIMULATED:
        for announcement in running_engines(runtime_folder()):
            if announcement.rig == rig:
                return EngineClient.attach(announcement)
    return EngineClient.start(rig)


@dataclass(frozen=True, slots=True)
class _Asked:
    command: str
    at_ms: int
    done: Callable[[dict[str, Any]], None] | None


class EngineLink(QObject):
    """One engine at a time. All signals come from :meth:`poll`, in the window's thread."""

    opened = Signal()
    closed = Signal(str)
    refused = Signal(str, str)
    happened = Signal(dict)
    status_changed = Signal(object)
    heard = Signal(float)
    silent = Signal(float)
    stop_unanswered = Signal()

    def __init__(self, open_client: Opener = open_engine) -> None:
        super().__init__()
        self._open_client = open_client
        self._client: Client | None = None
        self._results: SimpleQueue[Client | Exception] = SimpleQueue()
        self._threads: list[threading.Thread] = []
        self._asked: dict[int, _Asked] = {}
        self._clock = QElapsedTimer()
        self._clock.start()
        self._heard_ms = 0
        self._opening = False
        self.status = EngineStatus()

    @property
    def is_open(self) -> bool:
        """Whether requests can be sent."""
        return self._client is not None

    @property
    def engines(self) -> tuple[str, ...]:
        """Name of the engine that requests go to; empty while there is none."""
        return (self._client.announcement.name,) if self._client is not None else ()

    @property
    def live(self) -> LiveView | None:
        """Live samples, None while no engine is there."""
        return self._client.live if self._client is not None else None

    def open(self, rig: str, world: str = "") -> None:
        """Begin to connect; :attr:`opened` or :attr:`closed` follows."""
        if self._opening or self._client is not None:
            return
        self._opening = True
        self._in_thread(lambda: self._results.put(self._try_open(rig, world)))

    def ask(
        self, command: str, done: Callable[[dict[str, Any]], None] | None = None, **args: Any
    ) -> None:
        """Send a request; ``done`` gets its result, a refusal comes as :attr:`refused`."""
        if self._client is None:
            self.refused.emit(command, "no rig is connected: press Connect first")
            return
        try:
            number = self._client.send(command, **args)
        except RigctlError as error:
            self._lose(str(error))
            return
        self._asked[number] = _Asked(command, self._clock.elapsed(), done)

    def poll(self) -> None:
        """Take what came: called by the window's timer."""
        self._take_opened()
        if self._client is None:
            return
        try:
            messages = self._client.drain()
        except RigctlError as error:
            self._lose(str(error))
            return
        if messages:
            self._heard_ms = self._clock.elapsed()
        for message in messages:
            self._take(message)
        self._look_at_clock()

    def close(self) -> None:
        """Leave the engine; one that this window started and that runs no protocol is ended."""
        client, self._client = self._client, None
        if client is None:
            return
        leave = client.close if self.status.run.is_active else client.shut_down
        self._in_thread(lambda: _quietly(leave))
        self._forget()
        self.closed.emit("not connected")

    def wait_closed(self, limit_s: float = 35.0) -> None:
        """Wait for the threads that open and close engines; an engine opened too late is left."""
        for thread in self._threads:
            thread.join(limit_s)
        while not self._results.empty():
            if not isinstance(found := self._results.get(), Exception):
                found.shut_down()

    def _in_thread(self, action: Callable[[], object]) -> None:
        self._threads = [thread for thread in self._threads if thread.is_alive()]
        thread = threading.Thread(target=action, name="rigctl-engine-door")
        self._threads.append(thread)
        thread.start()

    def _try_open(self, rig: str, world: str) -> Client | Exception:
        try:
            return self._open_client(rig, world)
        except Exception as error:  # noqa: BLE001  # top of a thread: shown in the window
            return error

    def _take_opened(self) -> None:
        try:
            found = self._results.get_nowait()
        except Empty:
            return
        self._opening = False
        if isinstance(found, Exception):
            self.closed.emit(str(found))
            return
        self._client = found
        self._forget()
        self.opened.emit()

    def _take(self, message: dict[str, Any]) -> None:
        if "reply" in message:
            self._take_reply(message)
        elif message.get("event") == "status":
            self.status = parse_status(message.get("data") or {})
            self.heard.emit(float(message.get("at_s", 0.0)))
            self.status_changed.emit(self.status)
        else:
            self.happened.emit(message)

    def _take_reply(self, message: dict[str, Any]) -> None:
        asked = self._asked.pop(message["reply"], None)
        if asked is None:
            return
        if not message.get("ok"):
            self.refused.emit(asked.command, str(message.get("error", "refused")))
        elif asked.done is not None:
            asked.done(message.get("result") or {})

    def _look_at_clock(self) -> None:
        now_ms = self._clock.elapsed()
        if (quiet_s := (now_ms - self._heard_ms) / 1000) > SILENCE_LIMIT_S:
            self.silent.emit(quiet_s)
        late = [
            number
            for number, asked in self._asked.items()
            if asked.command == "stop" and now_ms - asked.at_ms > 1000 * STOP_LIMIT_S
        ]
        for number in late:
            del self._asked[number]
            self.stop_unanswered.emit()

    def _lose(self, sentence: str) -> None:
        client, self._client = self._client, None
        if client is not None:
            client.close()
        self._forget()
        self.closed.emit(sentence)

    def _forget(self) -> None:
        self._asked.clear()
        self.status = EngineStatus()
        self._heard_ms = self._clock.elapsed()


def _quietly(leave: Callable[[], object]) -> None:
    try:
        leave()
    except RigctlError:
        return  # it is gone already, which is what was wanted
