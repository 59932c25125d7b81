"""A client of the engine: starts one or joins one, asks, listens, and may die at any time."""

from __future__ import annotations

import select
import socket
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import IO, Any

from rigctl.acquisition.live_buffer import LiveView
from rigctl.acquisition.rpc.engine_files import (
    EngineFile,
    announcement_path,
    new_name,
    read_announcement,
    running_engines,
    runtime_folder,
)
from rigctl.acquisition.rpc.messages import LINE_LIMIT_BYTES, decode_message, encode_message
from rigctl.errors import LinkLost, RigctlError, RigFault, WrongUse

START_LIMIT_S = 60.0
COMPILE_LIMIT_S = 600.0
"""An engine's first start after an update compiles, on a busy machine for minutes; one that ends
instead is noticed at once."""
_LOOK_S = 0.02


class EngineRefusal(RigctlError):
    """The engine's answer was no; its sentence, and how a program should end because of it."""

    def __init__(self, sentence: str, exit_code: int) -> None:
        super().__init__(sentence)
        self.exit_code = exit_code


class EngineClient:
    """One connection to one engine, for a window or a command line.

    All calls are from one thread. ``clock`` bounds waiting only; a client has no loop.
    """

    def __init__(
        self,
        announcement: EngineFile,
        process: subprocess.Popen[bytes] | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.announcement = announcement
        self.process = process
        self._clock = clock
        self._events: deque[dict[str, Any]] = deque(maxlen=100_000)
        self._replies: dict[int, dict[str, Any]] = {}
        self._waiting: set[int] = set()
        self._received = bytearray()
        self._last_id = 0
        self._live: LiveView | None = None
        self._lost = ""
        self._socket = _connect(announcement)
        self._write({"token": announcement.token})

    @classmethod
    def start(
        cls,
        rig: str,
        *,
        paced: bool = True,
        seed: int = 0,
        run: Sequence[str] = (),
        limit_s: float = START_LIMIT_S,
    ) -> EngineClient:
        """Start an engine on that rig and join it once its boards have answered.

        ``run``: further arguments of the engine, such as make it start a protocol at once.
        Raises what kept the rig from opening, with its exit code.
        """
        name = new_name()
        folder = runtime_folder()
        process, log = _spawn(folder, name, rig, paced, seed, run)
        try:
            client = cls(_await_announcement(folder, name, process, log), process)
        finally:
            log.close()
        try:
            client._await_ready(limit_s)
        except RigctlError:
            client.close()
            process.terminate()  # it makes the rig safe first
            process.wait()
            raise
        return client

    @classmethod
    def attach(cls, announcement: EngineFile | None = None) -> EngineClient:
        """Join a running engine, the newest one unless told which; WrongUse where none runs."""
        if announcement is not None:
            return cls(announcement)
        engines = running_engines(runtime_folder())
        if not engines:
            raise WrongUse("no engine is running: start one with `rigctl run` or the window")
        return cls(engines[0])

    @property
    def live(self) -> LiveView:
        """The engine's live data."""
        if self._live is None:
            self._live = LiveView(Path(self.announcement.live))
        return self._live

    @property
    def connected(self) -> bool:
        """Whether the engine still talks to this client, as far as the last call saw."""
        return not self._lost

    def send(self, command: str, **args: Any) -> int:
        """Send a request and return its id; its reply comes out of :meth:`drain`."""
        self._last_id += 1
        self._write({"id": self._last_id, "command": command, "args": args})
        return self._last_id

    def request(self, command: str, *, limit_s: float = 10.0, **args: Any) -> dict[str, Any]:
        """Send a request, wait for its answer and return the result.

        Raises EngineRefusal with the engine's sentence, LinkLost where no answer came.
        Events that arrive meanwhile are kept for :meth:`drain`.
        """
        number = self.send(command, **args)
        self._waiting.add(number)
        try:
            self._wait_until(lambda: number in self._replies, limit_s, f"no answer to {command!r}")
        finally:
            self._waiting.discard(number)
        reply = self._replies.pop(number)
        if not reply["ok"]:
            raise EngineRefusal(str(reply["error"]), int(reply.get("exit_code", 3)))
        return dict(reply["result"])

    def drain(self) -> list[dict[str, Any]]:
        """Every event and reply that came since the last call, oldest first; never waits.

        Raises LinkLost once, after everything the engine said was drained.
        """
        self._receive(0.0)
        drained = list(self._events)
        self._events.clear()
        if self._lost and not drained:
            raise LinkLost(self._lost)
        return drained

    def wait(self, limit_s: float) -> list[dict[str, Any]]:
        """Like :meth:`drain`, but waits up to ``limit_s`` for something to come."""
        if not self._events:
            self._receive(limit_s)
        return self.drain()

    def close(self) -> None:
        """Leave; the engine goes on with what it does."""
        if self._live is not None:
            self._live.close()
            self._live = None
        self._socket.close()
        self._lost = self._lost or "this client left the engine"

    def shut_down(self, limit_s: float = 30.0) -> int | None:
        """Ask the engine to make the rig safe and end; its exit code where this client knows it."""
        if not self._lost:
            self.send("shutdown")
        self.close()
        if self.process is None:
            return None
        try:
            return self.process.wait(limit_s)
        except subprocess.TimeoutExpired as error:
            raise RigFault(
                f"the engine (process {self.process.pid}) did not end within {limit_s:.0f} s: "
                "press the emergency stop if the drum still moves, then end that process"
            ) from error

    def _await_ready(self, limit_s: float) -> None:
        self._wait_until(self._has_begun, limit_s, "the rig did not answer")
        for message in self._events:
            if message.get("event") == "failed":
                raise EngineRefusal(message["text"], int(message["data"]["exit_code"]))

    def _has_begun(self) -> bool:
        return any(message.get("event") in ("ready", "failed") for message in self._events)

    def _wait_until(self, done: Callable[[], bool], limit_s: float, what: str) -> None:
        end = self._clock() + limit_s
        while not done():
            left = end - self._clock()
            if self._lost:
                raise LinkLost(self._lost)
            if left <= 0:
                raise LinkLost(
                    f"{what} within {limit_s:.0f} s: the engine (process "
                    f"{self.announcement.pid}) hangs; end it and start again"
                )
            self._receive(left)

    def _receive(self, limit_s: float) -> None:
        """Take what has arrived, waiting up to the limit for the first byte."""
        while not self._lost and select.select([self._socket], [], [], limit_s)[0]:
            limit_s = 0.0
            try:
                data = self._socket.recv(1 << 18)
            except OSError as error:
                self._lose(error.strerror or "connection broken")
                break
            if not data:
                self._lose("its end of the connection closed")
            self._split(data)

    def _split(self, data: bytes) -> None:
        self._received += data
        *lines, rest = self._received.split(b"\n")
        self._received = bytearray(rest)
        if len(rest) > LINE_LIMIT_BYTES:
            self._lose("it sent a line without end")
        for line in lines:
            self._sort(decode_message(bytes(line)))

    def _sort(self, message: dict[str, Any]) -> None:
        if message.get("reply") in self._waiting:
            self._replies[int(message["reply"])] = message
        else:
            self._events.append(message)

    def _write(self, message: dict[str, Any]) -> None:
        try:
            self._socket.sendall(encode_message(message))
        except OSError as error:
            self._lose(error.strerror or "connection broken")
            raise LinkLost(self._lost) from error

    def _lose(self, why: str) -> None:
        self._lost = f"the engine ended ({why}): start it again; the session it wrote is kept"


def _connect(announcement: EngineFile) -> socket.socket:
    try:
        connection = socket.create_connection(("127.0.0.1", announcement.port), timeout=10.0)
    except OSError as error:
        raise LinkLost(
            f"engine {announcement.name} does not answer on port {announcement.port} "
            f"({error.strerror}): it may just have ended; start it again"
        ) from error
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return connection


def _spawn(
    folder: Path, name: str, rig: str, paced: bool, seed: int, run: Sequence[str]
) -> tuple[subprocess.Popen[bytes], IO[bytes]]:
    """An engine in a process group of its own, so that a Ctrl-C for us is not one for it."""
    command = [sys.executable, "-m", "rigctl", "engine", "--rig", rig, "--name", name]
    command += ["--seed", str(seed), *(["--paced"] if paced else []), *run]
    log = (folder / f"{name}.log").open("w+b")
    process = subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=log,
        stderr=log,
        start_new_session=sys.platform != "win32",
        creationflags=0x200 if sys.platform == "win32" else 0,  # a process group of its own
    )
    return process, log


def _await_announcement(
    folder: Path, name: str, process: subprocess.Popen[bytes], log: IO[bytes]
) -> EngineFile:
    """Wait for the engine's file; where it ends instead, say what it said."""
    path = announcement_path(folder, name)
    for _ in range(round(COMPILE_LIMIT_S / _LOOK_S)):
        found = read_announcement(path)
        if found is not None:
            return found
        try:
            code = process.wait(_LOOK_S)
        except subprocess.TimeoutExpired:
            continue
        raise EngineRefusal(_last_words(log), code if code > 0 else 3)
    process.terminate()
    process.wait()
    raise RigFault(f"the engine did not start within {COMPILE_LIMIT_S:.0f} s: see {log.name}")


def _last_words(log: IO[bytes]) -> str:
    log.seek(0)
    lines = log.read().decode(errors="replace").strip().splitlines()
    last = lines[-1] if lines else "the engine ended without a word: start it again"
    return last.removeprefix("rigctl: ")
