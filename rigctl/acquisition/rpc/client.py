"""A client of the engine: starts one or attaches to one, sends requests, receives events."""

from __future__ import annotations

import getpass
import os
import select
import socket
import struct
import subprocess
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from rigctl.acquisition.live_buffer import LiveReader
from rigctl.acquisition.rpc.engine_files import (
    DRUM_EXPERIMENT,
    EngineFile,
    connecting_socket,
    running_engines,
    socket_address,
)
from rigctl.acquisition.rpc.engine_launch import (
    EngineRefusal,
    spawn_engine,
    wait_for_engine_file,
)
from rigctl.acquisition.rpc.messages import (
    DISCONNECTED,
    LINE_LIMIT_BYTES,
    decode_message,
    encode_message,
)
from rigctl.acquisition.rpc.queues.message_queue import MessageQueue
from rigctl.acquisition.rpc.queues.outbox import Outbox
from rigctl.acquisition.rpc.runtime_folder import new_engine_name, runtime_folder
from rigctl.errors import LinkLost, RigctlError, RigFault, WrongUse

START_TIMEOUT_S = 60.0
WAIT_TIMEOUT_S = 10
LEAVE_TIMEOUT_S = 5.0
"""An engine that does not answer in this time is left as it is."""
READ_BYTES, MAX_READS = 1 << 18, 8
NAME_LETTERS = 80
"""Of a client's name."""
COMMAND_LINE, WINDOW = "command line", "window"
"""The programs that are clients."""
BEHIND = "the engine has not read the requests before this one: wait, or press STOP"
BEFORE_STOP = "STOP came before this request was sent"
ENGINE_COMMAND, FINGER_ENGINE_COMMAND = "engine", "finger-engine"


class EngineSilent(LinkLost):
    """The engine is there and does not answer."""


class EngineClient:
    """One connection to one engine. ``program``: whose, for those who read what it did.

    All calls are from one thread.
    """

    def __init__(
        self,
        engine_file: EngineFile,
        process: subprocess.Popen[bytes] | None = None,
        program: str = COMMAND_LINE,
    ) -> None:
        self.engine_file = engine_file
        self.process = process
        self._messages = MessageQueue()
        self._replies: dict[int, dict[str, Any]] = {}  # of awaited requests, empty before it comes
        self._outbox = Outbox()
        self._received = bytearray()
        self.received_bytes = 0
        self._last_id = 0
        self._live: LiveReader | None = None
        self._link_error = ""
        self._is_disconnected = False
        self._socket = _connect(engine_file)
        login = {"token": engine_file.token, "name": client_name(program)}
        self._outbox.put(encode_message(login))
        self._send_waiting()

    @classmethod
    def start(
        cls,
        rig: str,
        *,
        paced: bool = True,
        seed: int = 0,
        run: Sequence[str] = (),
        command: str = ENGINE_COMMAND,
    ) -> EngineClient:
        """Start an engine on this rig and connect to it once its boards have answered.

        ``run``: further arguments of the engine, such as those that start a protocol.
        ``command``: the hidden command that is the engine.
        Raises the reason why the rig did not open, with its exit code.
        """
        name = new_engine_name()
        folder = runtime_folder()
        process, log = spawn_engine(folder, name, rig, paced, seed, run, command)
        try:
            client = cls(wait_for_engine_file(folder, name, process, log), process)
        finally:
            log.close()
        try:
            client._wait_ready()
        except RigctlError:
            client.close()
            process.terminate()  # it makes the rig safe first
            process.wait()
            raise
        return client

    @classmethod
    def attach(cls, experiment: str = DRUM_EXPERIMENT) -> EngineClient:
        """Connect to the newest running engine of an experiment. Raises WrongUse without one."""
        running = running_engines(runtime_folder())
        engines = [engine for engine in running if engine.experiment == experiment]
        if not engines:
            raise WrongUse("no engine is running: start one with `rigctl run` or the window")
        return cls(engines[0])

    @property
    def live(self) -> LiveReader:
        """The engine's live data."""
        if self._live is None:
            self._live = LiveReader(Path(self.engine_file.live))
        return self._live

    def fileno(self) -> int:
        """Return the descriptor that is readable when messages have arrived."""
        return self._socket.fileno()

    @property
    def is_behind(self) -> bool:
        """Whether requests wait because the engine does not read."""
        return bool(self._outbox)

    def send(self, command: str, **args: Any) -> int:
        """Send a request without waiting and return its id; :meth:`drain` returns its reply.

        What the engine does not read waits here; :meth:`drain` and :meth:`wait` send it. STOP
        takes the place of what waits. Raises EngineRefusal where too much waits, LinkLost.
        """
        if command == "stop":
            self._give_up_waiting()
        elif self._outbox.is_full:
            raise EngineRefusal(BEHIND, LinkLost.exit_code)
        self._last_id += 1
        message = {"id": self._last_id, "command": command, "args": args}
        self._outbox.put(encode_message(message), self._last_id)
        if not self._send_waiting():
            raise LinkLost(self._link_error)
        return self._last_id

    def request(self, command: str, *, timeout_s: float = 10.0, **args: Any) -> dict[str, Any]:
        """Send a request, wait for its reply and return the result.

        Raises EngineRefusal with the engine's sentence, LinkLost where no reply came.
        :meth:`drain` returns the events that arrive meanwhile.
        """
        number = self.send(command, **args)
        self._replies[number] = {}
        try:
            self._wait_until(
                lambda: bool(self._replies[number]), timeout_s, f"no answer to {command!r}"
            )
        finally:
            reply = self._replies.pop(number)
        if not reply["ok"]:
            raise EngineRefusal(str(reply["error"]), int(reply.get("exit_code", 3)))
        return dict(reply["result"])

    def drain(self) -> list[dict[str, Any]]:
        """Return the events and replies since the last call, oldest first, without waiting.

        Raises LinkLost once the link is lost and all messages are returned.
        """
        self._receive(0.0)
        drained = self._messages.take()
        if self._link_error and not drained:
            raise LinkLost(self._link_error)
        return drained

    def wait(self, timeout_s: float) -> list[dict[str, Any]]:
        """Return the same as :meth:`drain`, after a wait of up to ``timeout_s`` for a message."""
        if not self._messages:
            self._receive(timeout_s)
        return self.drain()

    def close(self) -> None:
        """Close the connection; the engine continues, unless it was lost because it ended."""
        if self._link_error:
            self._note_end()
        if self._live is not None:
            self._live.close()
            self._live = None
        self._socket.close()
        self._link_error = self._link_error or "this client closed the connection"

    def shut_down(self, timeout_s: float = 30.0) -> int | None:
        """End the engine, which makes the rig safe; return its exit code where it is our process.

        An engine that has disconnected this client goes on. Raises EngineRefusal where another
        client has control, and the engine goes on; RigFault where it does not end in time.
        """
        try:
            if not self._link_error:
                self.request("shutdown")
        except LinkLost:
            pass  # it has ended, or is too busy to answer: its process tells
        finally:
            self.close()
        return None if self._is_disconnected else self._wait_ended(timeout_s)

    def leave(self, timeout_s: float = 30.0) -> int | None:
        """End the engine as :meth:`shut_down` where nobody else uses it and nothing runs.

        Else only leave it: its other clients and its run go on. Raises EngineRefusal, LinkLost,
        EngineSilent where it does not answer, and is left as it is.
        """
        ends = False
        try:
            lost = bool(self._link_error)
            ends = lost or bool(self.request("leave", timeout_s=LEAVE_TIMEOUT_S)["ends"])
            ends = ends and not self._is_disconnected
        finally:
            self.close()
            if not ends:
                self._note_end()
        return self._wait_ended(timeout_s) if ends else None

    def _note_end(self) -> None:
        """Wait for the engine's end in a thread of its own, so that it leaves no zombie."""
        if self.process is not None and self.process.poll() is None:
            wait = self.process.wait
            threading.Thread(target=wait, daemon=True, name="rigctl-engine-end").start()

    def _wait_ended(self, timeout_s: float) -> int | None:
        if self.process is None:
            return None
        try:
            return self.process.wait(timeout_s)
        except subprocess.TimeoutExpired as error:
            raise RigFault(
                f"the engine (process {self.process.pid}) did not end within {timeout_s:.0f} s: "
                "press the emergency stop if the drum still moves, then end that process"
            ) from error

    def _wait_ready(self) -> None:
        self._wait_until(self._has_started, START_TIMEOUT_S, "the rig did not answer")
        for message in self._messages:
            if message.get("event") == "failed":
                raise EngineRefusal(message["text"], int(message["data"]["exit_code"]))

    def _has_started(self) -> bool:
        return any(message.get("event") in ("ready", "failed") for message in self._messages)

    def _wait_until(self, is_done: Callable[[], bool], timeout_s: float, failure: str) -> None:
        end_s = time.monotonic() + timeout_s
        while not is_done():
            remaining_s = end_s - time.monotonic()
            if self._link_error:
                raise LinkLost(self._link_error)
            if remaining_s <= 0:
                raise EngineSilent(
                    f"{failure} within {timeout_s:.0f} s: the engine (process "
                    f"{self.engine_file.pid}) hangs; end it and start again"
                )
            self._receive(remaining_s)

    def _receive(self, timeout_s: float) -> None:
        """Read what has arrived, after a wait of up to the timeout for the first byte.

        What is more than a few reads stays for the next call, so that an engine that sends faster
        than this program reads does not keep it here.
        """
        for _ in range(MAX_READS):
            if self._link_error or not self._is_readable(timeout_s):
                break
            timeout_s = 0.0
            try:
                data = self._socket.recv(READ_BYTES)
            except OSError as error:
                self._set_lost(error.strerror or "connection broken")
                break
            self.received_bytes += len(data)
            if not data:
                self._set_lost("it closed the connection")
            self._split_lines(data)

    def _split_lines(self, data: bytes) -> None:
        self._received += data
        *lines, rest = self._received.split(b"\n")
        self._received = bytearray(rest)
        if len(rest) > LINE_LIMIT_BYTES:
            self._set_lost("it sent a line that is too long")
        for line in lines:
            try:
                message = decode_message(bytes(line))
            except ValueError:
                self._set_lost("it sent a line that is no message")
                return
            self._keep(message)

    def _keep(self, message: dict[str, Any]) -> None:
        """Keep a message until somebody takes it."""
        if message.get("reply") in self._replies:
            self._replies[message["reply"]] = message
        elif message.get("event") == DISCONNECTED:
            self._is_disconnected = True
            self._link_error = str(message.get("text"))
        else:
            self._messages.put(message)

    def _is_readable(self, timeout_s: float) -> bool:
        """Return whether something has arrived; send what waits as soon as the engine reads."""
        writes = [self._socket] if self._outbox else []
        readable, writable, _ = select.select([self._socket], writes, [], timeout_s)
        if writable:
            self._send_waiting()
        return bool(readable)

    def _send_waiting(self) -> bool:
        """Send what the socket takes; return whether the link holds."""
        try:
            self._outbox.flush(self._socket)
        except OSError as error:
            self._set_lost(error.strerror or "connection broken")
            return False
        return True

    def _give_up_waiting(self) -> None:
        """Refuse what waits to be sent, so that nothing of it is executed after a STOP."""
        for number in self._outbox.drop_requests():
            refusal = {"reply": number, "ok": False, "error": BEFORE_STOP}
            self._keep(refusal | {"exit_code": LinkLost.exit_code})

    def _set_lost(self, why: str) -> None:
        if self._link_error:
            return  # the engine has said why
        self._link_error = self._lost_text(why)

    def _lost_text(self, why: str) -> str:
        """Return what a broken connection means."""
        return f"the engine ended ({why}): start it again; the session it wrote is kept"


def client_name(program: str) -> str:
    """Return what other clients read of this one: the program, its user, computer and process."""
    try:
        user = getpass.getuser()
    except (KeyError, OSError):
        user = "unknown"
    name = f"{program} of {user} on {socket.gethostname()} (process {os.getpid()})"
    return "".join(letter for letter in name if letter.isprintable())[:NAME_LETTERS]


def _connect(engine_file: EngineFile) -> socket.socket:
    connection = connecting_socket(engine_file)
    _limit_waits(connection)
    try:
        connection.connect(socket_address(engine_file))
    except OSError as error:
        connection.close()
        where = engine_file.socket or f"port {engine_file.port}"
        raise LinkLost(
            f"engine {engine_file.name} does not answer on {where} "
            f"({error.strerror or error}): it may have just ended; start it again"
        ) from error
    if connection.family == socket.AF_INET:
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    connection.setblocking(False)
    return connection


def _limit_waits(connection: socket.socket) -> None:
    """Let connecting wait up to ten seconds.

    With a timeout of Python's, a Unix socket would refuse at once where others are in its queue.
    """
    if connection.family == socket.AF_INET:
        connection.settimeout(WAIT_TIMEOUT_S)
    else:
        limit = struct.pack("ll", WAIT_TIMEOUT_S, 0)  # struct timeval
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, limit)
