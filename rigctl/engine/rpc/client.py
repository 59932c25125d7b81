"""A client of the engine: starts one or joins one, sends requests, receives events; STOP for all.

:func:`stop_engines` and :func:`find_engines` talk to all engines of this user in parallel, so that
one that hangs does not delay the others.
"""

from __future__ import annotations

import getpass
import os
import select
import socket
import struct
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Collection, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import closing, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, NamedTuple

import msgspec

from rigctl import __version__
from rigctl.engine.live_file import LiveReader
from rigctl.engine.rpc.engine_files import (
    LIVE,
    LOG,
    EngineFile,
    connecting_socket,
    engine_file_path,
    is_crash_report,
    new_engine_name,
    read_engine_file,
    refuse_folder,
    remove_files,
    running_engines,
    runtime_folder,
    socket_address,
)
from rigctl.engine.rpc.messages import (
    DISCONNECTED,
    LINE_LIMIT_BYTES,
    ControlState,
    decode_message,
    encode_message,
    engine_message,
)
from rigctl.errors import LinkLost, RigctlError, RigFault, WrongUse
from rigctl.experiments import DRUM_EXPERIMENT

NO_ENGINE = "no engine is running: start one with `rigctl run` or the window"
COMPILE_TIMEOUT_S = 600.0
"""An engine's first start after an update compiles, on a busy machine for minutes; an engine that
ends instead is noticed immediately."""
LOG_ROOM_BYTES = 1 << 14
"""Of an engine's log when it starts: a folder without room has none for its last words."""
START_TIMEOUT_S = 60.0
WAIT_TIMEOUT_S = 10
LEAVE_TIMEOUT_S = 5.0
"""An engine that does not answer in this time is left as it is."""
STOP_TIMEOUT_S = 5.0
ASK_TIMEOUT_S = 3.0
READ_BYTES, MAX_READS = 1 << 18, 8
NAME_LETTERS = 80
"""Of a client's name."""
KEPT_MESSAGES = 5_000
"""Of events and replies that nobody has taken. Of statuses only the newest counts."""
MAX_WAITING = 64
"""Requests that wait to be sent: as many as the engine executes for one client at once."""
COMMAND_LINE, WINDOW = "command line", "window"
"""The programs that are clients."""
BEHIND = "the engine has not read the requests before this one: wait, or press STOP"
BEFORE_STOP = "STOP came before this request was sent"
ENGINE_COMMAND, FINGER_ENGINE_COMMAND = "engine", "finger-engine"
_POLL_S = 0.02
_ACTIVE = ("running", "paused", "prompt")


class EngineRefusal(RigctlError):
    """The engine's refusal, with the exit code for a program that ends because of it."""

    def __init__(self, sentence: str, exit_code: int) -> None:
        super().__init__(sentence)
        self.exit_code = exit_code


class EngineSilent(LinkLost):
    """The engine is there and does not answer."""


class _Waiting(NamedTuple):
    """A line that waits to be sent; ``number``: of its request, None for the login."""

    number: int | None
    data: bytes


class EngineClient:
    """One connection to one engine. ``program``: whose, for those who read what it did.

    All calls are from one thread. Raises LinkLost where nothing answers.
    """

    def __init__(
        self,
        engine_file: EngineFile,
        process: subprocess.Popen[bytes] | None = None,
        program: str = COMMAND_LINE,
    ) -> None:
        self.engine_file = engine_file
        self.process = process
        self._messages: deque[dict[str, Any]] = deque()
        self._left_out = 0
        self._replies: dict[int, dict[str, Any]] = {}  # of awaited requests, empty before it comes
        self._waiting: deque[_Waiting] = deque()
        self._sent_bytes = 0  # of the first line that waits
        self._received = bytearray()
        self._last_id = 0
        self._live: LiveReader | None = None
        self._link_error = ""
        self._is_disconnected = False
        self._socket = _connect(engine_file)
        login = {"token": engine_file.token, "name": client_name(program)}
        self._waiting.append(_Waiting(None, encode_message(login)))
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
            raise WrongUse(NO_ENGINE)
        return cls.join(engines[0])

    @classmethod
    def join(cls, engine: EngineFile) -> EngineClient:
        """Connect to a running engine. Raises WrongUse for one of another version of rigctl."""
        if engine.version != __version__:
            raise WrongUse(
                f"the engine of {engine.rig} (process {engine.pid}) is of rigctl "
                f"{engine.version or 'before 0.1'} and this is {__version__}: end its run with "
                "that version, then start again; STOP reaches it"
            )
        return cls(engine)

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
        return bool(self._waiting)

    def send(self, command: str, **args: Any) -> int:
        """Send a request without waiting and return its id; :meth:`drain` returns its reply.

        What the engine does not read waits here; :meth:`drain` and :meth:`wait` send it. STOP
        takes the place of what waits. Raises EngineRefusal where too much waits, LinkLost.
        """
        if command == "stop":
            self._give_up_waiting()
        elif len(self._waiting) >= MAX_WAITING:
            raise EngineRefusal(BEHIND, LinkLost.exit_code)
        self._last_id += 1
        message = {"id": self._last_id, "command": command, "args": args}
        self._waiting.append(_Waiting(self._last_id, encode_message(message)))
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
        drained = self._take_messages()
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
                self._keep(decode_message(bytes(line)))
            except ValueError:
                self._set_lost("it sent a line that is no message")
                return

    def _keep(self, message: dict[str, Any]) -> None:
        """Keep a message until somebody takes it; a status replaces an older one."""
        if message.get("reply") in self._replies:
            self._replies[message["reply"]] = message
            return
        if message.get("event") == DISCONNECTED:
            self._is_disconnected = True
            self._link_error = str(message["text"])
            return
        if message.get("event") == "status":
            for old in reversed(self._messages):  # it is near the end, if it is there
                if old.get("event") == "status":
                    self._messages.remove(old)
                    break
        elif len(self._messages) >= KEPT_MESSAGES:
            self._messages.popleft()
            self._left_out += 1
        self._messages.append(message)

    def _take_messages(self) -> list[dict[str, Any]]:
        """Return all messages, the oldest first; the first one tells what was left out."""
        taken = list(self._messages)
        self._messages.clear()
        if self._left_out:
            text = (
                f"{self._left_out} messages of the engine came while this program was busy and are "
                "left out: the session and the engine's history have what they told"
            )
            taken.insert(0, engine_message("left_out", text, {"messages": self._left_out}))
            self._left_out = 0
        return taken

    def _is_readable(self, timeout_s: float) -> bool:
        """Return whether something has arrived; send what waits as soon as the engine reads."""
        writes = [self._socket] if self._waiting else []
        readable, writable, _ = select.select([self._socket], writes, [], timeout_s)
        if writable:
            self._send_waiting()
        return bool(readable)

    def _send_waiting(self) -> bool:
        """Send what the socket takes, in order; return whether the link holds."""
        while self._waiting:
            data = self._waiting[0].data
            try:
                self._sent_bytes += self._socket.send(memoryview(data)[self._sent_bytes :])
            except BlockingIOError:
                return True
            except OSError as error:
                self._set_lost(error.strerror or "connection broken")
                return False
            if self._sent_bytes == len(data):
                self._waiting.popleft()
                self._sent_bytes = 0
        return True

    def _give_up_waiting(self) -> None:
        """Refuse what waits and is not begun, so that nothing of it is executed after a STOP."""
        waiting, self._waiting = list(self._waiting), deque()
        for place, line in enumerate(waiting):
            if line.number is None or (place == 0 and self._sent_bytes):
                self._waiting.append(line)
                continue
            refusal = {"reply": line.number, "ok": False, "error": BEFORE_STOP}
            self._keep(refusal | {"exit_code": LinkLost.exit_code})

    def _set_lost(self, why: str) -> None:
        if not self._link_error:  # else the engine has said why
            self._link_error = (
                f"the engine ended ({why}): start it again; the session it wrote is kept"
            )
            log = Path(self.engine_file.live.removesuffix(LIVE) + LOG)
            if is_crash_report(log):
                self._link_error += f"; please send its crash report to who looks after it: {log}"


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


def spawn_engine(
    folder: Path, name: str, rig: str, paced: bool, seed: int, run: Sequence[str], command: str
) -> tuple[subprocess.Popen[bytes], IO[bytes]]:
    """Start an engine in its own process group, so that our Ctrl-C does not reach it.

    Raises WrongUse where the folder takes no files.
    """
    words = [sys.executable, "-m", "rigctl", command, "--rig", rig, "--name", name]
    words += ["--seed", str(seed), *(["--paced"] if paced else []), *run]
    log = _create_log(folder / (name + LOG))
    process = subprocess.Popen(
        words,
        stdin=subprocess.DEVNULL,
        stdout=log,
        stderr=log,
        start_new_session=sys.platform != "win32",
        creationflags=0x200 if sys.platform == "win32" else 0,  # CREATE_NEW_PROCESS_GROUP
    )
    return process, log


def _create_log(path: Path) -> IO[bytes]:
    """Create an engine's log, which has room for its last words."""
    try:
        log = path.open("w+b")
        log.write(bytes(LOG_ROOM_BYTES))
        log.seek(0)  # writes what is buffered
        log.truncate()
    except OSError as error:
        with suppress(OSError):
            path.unlink(missing_ok=True)
        raise refuse_folder(path.parent, error) from error
    return log


def wait_for_engine_file(
    folder: Path, name: str, process: subprocess.Popen[bytes], log: IO[bytes]
) -> EngineFile:
    """Wait for the engine's file. Raises EngineRefusal with its last line where it ends instead.

    What an engine that was killed meanwhile has left is removed.
    """
    path = engine_file_path(folder, name)
    for _ in range(round(COMPILE_TIMEOUT_S / _POLL_S)):
        found = read_engine_file(path)
        if found is not None:
            return found
        try:
            code = process.wait(_POLL_S)
        except subprocess.TimeoutExpired:
            continue
        remove_files(folder, name)
        if code < 0:
            raise EngineRefusal(
                f"the engine was killed while it started (signal {-code}): start it again", 3
            )
        raise EngineRefusal(_last_line(log), code or 3)
    process.terminate()
    process.wait()
    raise RigFault(f"the engine did not start within {COMPILE_TIMEOUT_S:.0f} s: see {log.name}")


def _last_line(log: IO[bytes]) -> str:
    log.seek(0)
    lines = log.read().decode(errors="replace").strip().splitlines()
    last = lines[-1] if lines else "the engine ended without a message: start it again"
    return last.removeprefix("rigctl: ")


class StopResult(NamedTuple):
    """Result of STOP for one engine; ``failure``: why it did not stop, empty where it did."""

    rig: str
    pid: int
    failure: str

    @property
    def name(self) -> str:
        """The engine's name in a sentence."""
        return f"{self.rig} (process {self.pid})"


def stop_engines(
    report: Callable[[StopResult], None],
    exclude: Collection[str] = (),
    program: str = COMMAND_LINE,
) -> int:
    """Stop every engine but the excluded ones, report each result, return how many there were.

    ``program``: the caller, for the log of those engines. Waits for the slowest, at most a few
    seconds. Raises WrongUse where there can be no folder for engines.
    """
    running = running_engines(runtime_folder())
    engines = [engine for engine in running if engine.name not in exclude]
    with ThreadPoolExecutor(len(engines) or 1, "stop") as executor:
        for stop in as_completed([executor.submit(_stop, engine, program) for engine in engines]):
            report(stop.result())
    return len(engines)


def _stop(engine: EngineFile, program: str) -> StopResult:
    try:
        with closing(EngineClient(engine, program=program)) as client:
            client.request("stop", timeout_s=STOP_TIMEOUT_S)
    except Exception as error:  # noqa: BLE001 - top of a thread: the user must see every failure
        return StopResult(engine.rig, engine.pid, str(error))
    return StopResult(engine.rig, engine.pid, "")


@dataclass(frozen=True, slots=True)
class FoundEngine:
    """A running engine. ``run``: its run as the status has it, empty where it did not answer.

    ``queued``: how many runs wait. ``holder``: the name of the client that has control, empty for
    nobody. ``failure``: why it did not answer, empty where it did.
    """

    engine: EngineFile
    run: dict[str, Any]
    holder: str = ""
    failure: str = ""
    queued: int = 0

    @property
    def has_run(self) -> bool:
        """Whether it runs a protocol."""
        return self.run.get("state") in _ACTIVE

    @property
    def name(self) -> str:
        """The rig and the process."""
        return f"{self.engine.rig} (process {self.engine.pid})"

    def describe(self) -> str:
        """Return one sentence on what it does and who has control."""
        if self.failure:
            return f"does not answer ({self.failure})"
        what = self._run_words() if self.has_run else "no run"
        if self.queued:
            what += f", {self.queued} in the queue"
        return f"{what}; {self.holder or 'nobody'} has control"

    def _run_words(self) -> str:
        run = self.run
        word = {"paused": "paused run", "prompt": "run that waits for an answer"}
        state = word.get(str(run["state"]), "run")
        done, planned = run.get("trials_committed"), run.get("trials_planned")
        return f"{state}, {done} of {planned} trials, into {run.get('session')}"


def find_engines() -> list[FoundEngine]:
    """Return the running engines, newest first, with what each does.

    Waits for the slowest, a few seconds at most. Raises WrongUse where there can be no folder for
    engines.
    """
    engines = running_engines(runtime_folder())
    with ThreadPoolExecutor(len(engines) or 1, "find-engines") as executor:
        return list(executor.map(_ask, engines))


def _ask(engine: EngineFile) -> FoundEngine:
    try:
        with closing(EngineClient.join(engine)) as client:
            status = client.request("status", timeout_s=ASK_TIMEOUT_S)
            told = client.request("clients", timeout_s=ASK_TIMEOUT_S)
    except (RigctlError, OSError) as error:
        return FoundEngine(engine, {}, failure=str(error))
    holder = msgspec.convert(told, ControlState).holder_name
    queued = len(status.get("queue", {}).get("entries", ()))
    return FoundEngine(engine, dict(status["run"]), holder, queued=queued)
