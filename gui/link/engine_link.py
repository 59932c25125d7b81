"""The window's connection to an engine, which is started or joined in a thread.

Nothing here blocks. Requests are sent immediately, messages are processed as they arrive and on
each :meth:`EngineLink.poll`, and a timeout reports an engine that does not answer.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, Generic, NamedTuple, TypeVar

from PySide6.QtCore import QElapsedTimer, QObject, QSocketNotifier, Signal

from rigctl.engine.live_file import LiveReader
from rigctl.engine.rpc.client import (
    FINGER_ENGINE_COMMAND,
    WINDOW,
    EngineClient,
    EngineRefusal,
    EngineSilent,
    FoundEngine,
    StopResult,
    client_name,
    find_engines,
    stop_engines,
)
from rigctl.engine.rpc.engine_files import EngineFile, rig_name, running_engines, runtime_folder
from rigctl.engine.rpc.messages import DISCONNECTED_TEXT, EngineStatus
from rigctl.errors import LinkLost, RigctlError, WrongUse
from rigctl.experiments import DRUM_EXPERIMENT, FINGER_EXPERIMENT
from rigctl.finger.live_file import FingerLiveReader
from rigctl.finger.status import FingerEngineStatus

JOIN = "join"
ANOTHER = "another"
SIMULATED = ("virtual", "firmware")


class FingerEngineSpec(NamedTuple):
    """An engine of the moving finger.

    ``seed``, ``session`` and ``first_slide`` define the person and the sensor of a simulated rig.
    """

    rig: str
    seed: int = 0
    session: int = 0
    first_slide: int = 0


class EngineChoice(WrongUse):
    """Engines run already, and the user has to choose. ``may_start``: another one may start."""

    def __init__(self, sentence: str, engines: list[FoundEngine], *, may_start: bool) -> None:
        super().__init__(sentence)
        self.engines = engines
        self.may_start = may_start


def another_on(rig: str) -> str:
    """Return what names another engine on a simulated rig that has engines already."""
    return f"{ANOTHER}:{rig}"


def joined_rig(engine: EngineFile) -> str:
    """Return what names a running engine as a rig to join."""
    return f"{JOIN}:{engine.name}"


def shown_rig(rig: str) -> str:
    """Return the rig as the list of rigs has it."""
    return JOIN if is_joined(rig) else _without_another(rig)[0]


def is_joined(rig: str) -> bool:
    """Return whether a rig is a running engine, any one or a chosen one."""
    return rig.partition(":")[0] == JOIN


def open_client(rig: str, world: str = "") -> EngineClient:
    """Start or join an engine and return its client. Raises what prevents that.

    ``JOIN`` joins the running engine, :func:`joined_rig` a chosen one. A bench has one engine: if
    it already runs, this joins it. Simulated rigs can run several engines, each with the ``world``
    of a file, but the second one only by :func:`another_on`. Raises EngineChoice where the user
    has to choose.
    """
    if is_joined(rig):
        return _join(rig, DRUM_EXPERIMENT)
    rig, is_wanted = _without_another(rig)
    if (engine := _running(rig, DRUM_EXPERIMENT, is_wanted)) is not None:
        return EngineClient.join(engine)
    return EngineClient.start(rig, run=["--world", world] if world else ())


def open_finger_client(spec: FingerEngineSpec) -> EngineClient:
    """Start or join an engine of the moving finger, as :func:`open_client`.

    ``JOIN`` joins the running one, whatever its seed and session. A simulated rig runs in real
    time. Another person needs another engine, so the user chooses only where one has a run.
    """
    if is_joined(spec.rig):
        return _join(spec.rig, FINGER_EXPERIMENT)
    if _without_another(spec.rig)[0] not in SIMULATED:
        if (engine := _running(spec.rig, FINGER_EXPERIMENT, is_wanted=False)) is not None:
            return EngineClient.join(engine)
        return EngineClient.start(spec.rig, command=FINGER_ENGINE_COMMAND)
    rig, is_wanted = _without_another(spec.rig)
    if not is_wanted:
        _offer_run(rig)
    person = ["--session", str(spec.session), "--first-slide", str(spec.first_slide)]
    return EngineClient.start(rig, seed=spec.seed, run=person, command=FINGER_ENGINE_COMMAND)


def _without_another(rig: str) -> tuple[str, bool]:
    """Return the rig, and whether another engine on it is wanted."""
    prefix, colon, named = rig.partition(":")
    return (named, True) if colon and prefix == ANOTHER else (rig, False)


def _join(rig: str, experiment: str) -> EngineClient:
    """Join the chosen engine, or the only one. Raises WrongUse where there is none."""
    name = rig.partition(":")[2]
    engines = [engine for engine in find_engines() if engine.engine.experiment == experiment]
    if not name and len(engines) > 1:
        sentence = f"{len(engines)} engines run: choose the one to join."
        raise EngineChoice(sentence, engines, may_start=False)
    for engine in engines:
        if name in ("", engine.engine.name):
            return EngineClient.join(engine.engine)
    if name:
        raise WrongUse(f"engine {name} has ended: connect to its rig to start another one")
    raise WrongUse("no engine is running: choose a rig and press Connect")


def _offer_run(rig: str) -> None:
    """Raise EngineChoice where an engine of a simulated finger has a run."""
    found = [
        engine
        for engine in find_engines()
        if engine.has_run
        and (engine.engine.rig, engine.engine.experiment) == (rig, FINGER_EXPERIMENT)
    ]
    if found:
        raise EngineChoice(f"A run goes on on the {rig} finger.", found, may_start=True)


def _running(rig: str, experiment: str, is_wanted: bool) -> EngineFile | None:
    """Return the running engine of a bench, None without one.

    ``is_wanted``: another engine on a simulated rig is. Raises EngineChoice where one runs and
    nobody has said so.
    """
    name = rig_name(rig)
    same = [
        e for e in running_engines(runtime_folder()) if (e.rig, e.experiment) == (name, experiment)
    ]
    if rig not in SIMULATED:
        return same[0] if same else None
    if same and not is_wanted:
        found = [engine for engine in find_engines() if engine.engine in same]
        raise EngineChoice(f"An engine of the {rig} rig runs already.", found, may_start=True)
    return None


SILENCE_TIMEOUT_S = 1.5
STOP_TIMEOUT_S = 0.5
CLOSE_TIMEOUT_S = 35.0
NOT_CONNECTED = "not connected"
THIS_WINDOW = "this window"
NO_ENGINE = "STOP: no engine is running; press the rig's emergency stop if the drum moves"
STOP_TIMED_OUT = "STOP was sent, but the engine does not answer: press the emergency stop"
LEFT_RUNNING = "the engine of {rig} (process {pid}) does not answer and is left running: {cure}"
LIFTS = "while it is silent the drum lifts by itself; look at the rig, and "
END_IT = "end that process if it stays"

ClientFactory = Callable[..., EngineClient]
"""Opens the engine that the arguments of :meth:`EngineLink.open` name; raises if it cannot."""


_Status = TypeVar("_Status", bound=EngineStatus | FingerEngineStatus)
_Live = TypeVar("_Live", bound=LiveReader | FingerLiveReader)


class EngineLink(QObject, Generic[_Status, _Live]):
    """A connection to one engine. All signals arrive in the window's thread."""

    opened = Signal()
    opening = Signal(float)
    """Seconds since :meth:`open`, on each poll until it has an end."""
    closed = Signal(str)
    """The reason."""
    replied = Signal(str)
    """The command that the engine has executed."""
    answered = Signal(str, dict)
    """The command that the engine has executed, and its result."""
    refused = Signal(str, str)
    """The command and the engine's error message."""
    choice_needed = Signal(object)
    """The :class:`EngineChoice` that kept the link closed: engines run already."""
    interrupted = Signal(str)
    """A command that a STOP of this window ended."""
    event_received = Signal(dict)
    status_changed = Signal(object)
    """The new status."""
    silent = Signal(float)
    """Seconds since the last message, on each poll while they exceed the timeout."""
    reported = Signal(str, str)
    """Kind and text for the event log: the result of STOP for an engine, or of leaving one."""

    def __init__(
        self,
        factory: ClientFactory,
        parse: Callable[[Mapping[str, Any]], _Status],
        open_live: Callable[[Path], _Live],
    ) -> None:
        """Take what opens an engine, and what reads the status and live data of its experiment."""
        super().__init__()
        self._factory, self._parse, self._open_live = factory, parse, open_live
        self._client: EngineClient | None = None
        self._notifier: QSocketNotifier | None = None
        self._opened: SimpleQueue[tuple[int, EngineClient | Exception]] = SimpleQueue()
        """Number of each attempt that has an end, and what came of it."""
        self._attempt = 0
        self._opening_since_ms = 0
        self._threads: list[threading.Thread] = []
        self._pending: dict[int, tuple[str, int]] = {}
        """Command and time in ms of each request without a reply, by its number."""
        self._stop_number = 0
        """Number of the last STOP: it ends what was requested before."""
        self._late_stops: set[int] = set()
        """Numbers of the STOPs that the window has told to be without an answer."""
        self._clock = QElapsedTimer()
        self._clock.start()
        self._last_message_ms = 0
        self._is_opening = self._is_lost = False
        self.lost_engine: EngineFile | None = None
        """The engine that was lost since :meth:`open`; one that goes on is not lost."""
        self.engine: EngineFile | None = None
        """The engine that is connected, or was last."""
        self.spared: Callable[[], Collection[str]] = frozenset
        """Returns the names of engines that :meth:`stop` leaves alone."""
        self.left_running: list[str] = []
        """A sentence for each engine that did not end or answer when this window left it."""
        self.live: _Live | None = None
        """The live data, None without a connection."""
        self.status: _Status = parse({})

    @property
    def is_connected(self) -> bool:
        """Whether there is an engine."""
        return self._client is not None

    @property
    def is_waiting(self) -> bool:
        """Whether a command has no answer yet, such as a move that goes on."""
        return bool(self._pending)

    @property
    def is_unheard(self) -> bool:
        """Whether nobody knows what the rig does: silent, or lost, and no STOP has followed."""
        silence_ms = self._clock.elapsed() - self._last_message_ms
        return self._is_lost or (self.is_connected and silence_ms > 1000 * SILENCE_TIMEOUT_S)

    @property
    def has_joined(self) -> bool:
        """Whether the engine ran before this window connected to it."""
        return self._client is not None and self._client.process is None

    def open(self, *engine: Any) -> None:
        """Start to connect; ``engine``: the factory's arguments.

        :attr:`opened` or :attr:`closed` follows.
        """
        if self._is_opening or self._client is not None:
            return
        self._is_opening, self.lost_engine = True, None
        self._attempt += 1
        self._opening_since_ms = self._clock.elapsed()
        number = self._attempt
        self._run_in_thread(lambda: self._opened.put((number, self._try_open(*engine))))

    def request(self, command: str, **args: Any) -> None:
        """Send a request; :attr:`replied` or :attr:`refused` follows."""
        if self._client is None:
            self.refused.emit(command, "no rig is connected: press Connect first")
            return
        try:
            number = self._client.send(command, **args)
        except EngineRefusal as refusal:
            self.refused.emit(command, str(refusal))
            return
        except RigctlError as error:
            self._lose(str(error))
            return
        self._pending[number] = (command, self._clock.elapsed())
        if command == "stop":
            self._stop_number = number

    def stop(self) -> None:
        """Stop the connected engine, then those not spared in a thread; :attr:`reported` follows.

        A connected engine that has not read what came before gets STOP by a new connection, too.
        """
        self.stop_own()
        self._is_lost = False
        client = self._client
        stopped = (
            {client.engine_file.name} if client is not None and not client.is_behind else set()
        )
        others = {*self.spared()} - {client.engine_file.name if client is not None else ""}
        self._run_in_thread(
            lambda: self._stop_others(stopped | others, is_linked=client is not None)
        )

    def stop_own(self) -> None:
        """Stop the connected engine, if there is one."""
        if self._client is not None:
            self.request("stop")

    def poll(self) -> None:
        """Process all messages that have arrived; the window's timer calls this."""
        self._take_opened()
        if self._client is None:
            return
        try:
            messages = self._client.drain()
        except RigctlError as error:
            self._lose(str(error))
            return
        if messages:
            self._last_message_ms = self._clock.elapsed()
        for message in messages:
            self._dispatch(message)
        self._check_timeouts()

    def close(self) -> None:
        """Disconnect; the engine ends unless it has another client or runs a protocol.

        While the link opens, this gives up; an engine that then starts is left in the same way.
        """
        if self._is_opening:
            self._is_opening = False
            self.closed.emit(NOT_CONNECTED)
        if self._client is not None:
            client = self._client
            self._drop_notifier()
            self._run_in_thread(lambda: self._leave(client))
            self._drop(NOT_CONNECTED)

    def wait_closed(self) -> None:
        """Wait for the threads of engines; leave an engine that opened late."""
        for thread in self._threads:
            thread.join(CLOSE_TIMEOUT_S)
        while not self._opened.empty():
            self._leave_opened(self._opened.get()[1])

    def _run_in_thread(self, action: Callable[[], object]) -> None:
        self._threads = [thread for thread in self._threads if thread.is_alive()]
        thread = threading.Thread(target=action, name="rigctl-engine-link")
        self._threads.append(thread)
        thread.start()

    def _try_open(self, *engine: Any) -> EngineClient | Exception:
        try:
            return self._factory(*engine)
        except Exception as error:  # noqa: BLE001  # top of a thread: shown in the window
            return error

    def _stop_others(self, stopped: Collection[str], *, is_linked: bool) -> None:
        """Stop every engine except ``stopped``. Qt passes the signal to the window's thread.

        ``is_linked``: this window has an engine, which knows of STOP.
        """
        try:
            if not stop_engines(self._report_stop, stopped, WINDOW) and not is_linked:
                self.reported.emit("stop", NO_ENGINE)
        except RigctlError as error:
            self.reported.emit("lost", f"STOP reached no engine: {error}")

    def _report_stop(self, result: StopResult) -> None:
        if result.failure:
            text = f"STOP did not reach {result.name}: press its emergency stop ({result.failure})"
            self.reported.emit("lost", text)
        else:
            self.reported.emit("stop", f"STOP reached {result.name}")

    def _leave_opened(self, result: EngineClient | Exception) -> None:
        """Leave an engine that opened for nobody."""
        if not isinstance(result, Exception):
            self._leave(result)

    def _leave(self, client: EngineClient) -> None:
        """Leave an engine; say so where it goes on although it should end."""
        try:
            client.leave()
            return
        except EngineSilent:
            pass
        except LinkLost:
            return  # it has ended already
        except RigctlError:
            pass
        engine = client.engine_file
        cure = LIFTS + END_IT if engine.experiment == DRUM_EXPERIMENT else END_IT
        sentence = LEFT_RUNNING.format(rig=engine.rig, pid=engine.pid, cure=cure)
        self.left_running.append(sentence)
        self.reported.emit("lost", sentence)

    def _take_opened(self) -> None:
        try:
            number, result = self._opened.get_nowait()
        except Empty:
            if self._is_opening:
                self.opening.emit((self._clock.elapsed() - self._opening_since_ms) / 1000)
            return
        if number != self._attempt or not self._is_opening:
            self._run_in_thread(lambda: self._leave_opened(result))
            return
        self._is_opening = False
        if isinstance(result, Exception):
            self.closed.emit(str(result))
            if isinstance(result, EngineChoice):
                self.choice_needed.emit(result)
            return
        try:
            self.live = self._open_live(Path(result.engine_file.live))
        except RigctlError as error:
            result.close()
            self.closed.emit(str(error))
            return
        self._client, self._is_lost = result, False
        self.engine = result.engine_file
        self._notifier = QSocketNotifier(result.fileno(), QSocketNotifier.Type.Read, self)
        self._notifier.activated.connect(self.poll)
        self._reset()
        self.opened.emit()

    def _dispatch(self, message: dict[str, Any]) -> None:
        if "reply" in message:
            self._dispatch_reply(message)
        elif message.get("event") == "status":
            self.status = self._parse(_status_here(message["data"]))
            self.status_changed.emit(self.status)
        else:
            text = name_this_window(message["text"])
            self.event_received.emit({**message, "text": text})

    def _dispatch_reply(self, message: dict[str, Any]) -> None:
        command, sent_ms = self._pending.pop(message["reply"], ("", 0))
        self._report_late_stop(message, sent_ms)
        if command and message.get("ok"):
            self.replied.emit(command)
            self.answered.emit(command, message.get("result") or {})
        elif command and command != "stop" and message["reply"] < self._stop_number:
            self.interrupted.emit(command)
        elif command:
            self.refused.emit(command, str(message.get("error", "refused")))

    def _report_late_stop(self, message: dict[str, Any], sent_ms: int) -> None:
        """Tell that the engine has executed a STOP after the window had said that it does not."""
        if message["reply"] not in self._late_stops:
            return
        self._late_stops.discard(message["reply"])
        if message.get("ok") and self._client is not None:
            engine = self._client.engine_file
            late = f"{(self._clock.elapsed() - sent_ms) / 1000:.1f} s after it was sent"
            text = f"STOP reached {engine.rig} (process {engine.pid}), {late}"
            self.reported.emit("stop", text)

    def _check_timeouts(self) -> None:
        now_ms = self._clock.elapsed()
        if (silence_s := (now_ms - self._last_message_ms) / 1000) > SILENCE_TIMEOUT_S:
            self.silent.emit(silence_s)
        late = [
            number
            for number, (command, sent_ms) in self._pending.items()
            if command == "stop" and now_ms - sent_ms > 1000 * STOP_TIMEOUT_S
        ]
        for number in set(late) - self._late_stops:
            self._late_stops.add(number)
            self.reported.emit("stop", STOP_TIMED_OUT)

    def _lose(self, reason: str) -> None:
        client = self._client
        self._drop_notifier()
        if client is not None:
            client.close()
            self.lost_engine = None if reason == DISCONNECTED_TEXT else client.engine_file
        self._is_lost = True
        self._drop(reason)

    def _drop_notifier(self) -> None:
        """Stop to watch the socket, which must be open then."""
        if self._notifier is not None:
            self._notifier.setEnabled(False)
            self._notifier.deleteLater()
            self._notifier = None

    def _drop(self, reason: str) -> None:
        self._client = None
        if self.live is not None:
            self.live.close()
            self.live = None
        self._reset()
        self.closed.emit(reason)

    def _reset(self) -> None:
        self._pending.clear()
        self._late_stops.clear()
        self._stop_number = 0
        self.status = self._parse({})
        self._last_message_ms = self._clock.elapsed()


def name_this_window(text: str) -> str:
    """Return a text of the engine in which this window is not one name among others."""
    return text.replace(client_name(WINDOW), THIS_WINDOW)


def _status_here(data: dict[str, Any]) -> dict[str, Any]:
    """Return the data of a status in which who ended the run may be this window."""
    names = {"run": "text", "queue": "waits_for"}
    parts = {part: {**data.get(part, {})} for part in names}
    for part, key in names.items():
        parts[part][key] = name_this_window(parts[part].get(key, ""))
    return {**data, **parts}
