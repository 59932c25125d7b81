"""Drive a rig, encode and analyse from a script or a notebook.

::

    import rigctl

    with rigctl.connect("virtual") as rig:
        rig.mount("A")
        rig.set(speed_mm_s=80, force_g=300)
        with rig.record("by-hand"):
            rig.tare()
            rig.approach()
            rig.turn()
            rig.lift()
        rig.run("quick.toml", "session")
    rigctl.encode("session", "spikes")
    report = rigctl.analyse("session", "report", iterations=5)

The rig lives in a process of its own, the engine, whose heartbeat does not depend on the script: a
script that sleeps or ends leaves no pressed drum behind, and ``rigctl stop`` and the window reach
the same rig meanwhile.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from rigctl.config.resources import find_protocol
from rigctl.engine.live_file import TaxelWindow
from rigctl.engine.motion import MOVE_TIMEOUT_S
from rigctl.engine.rpc.client import EngineClient
from rigctl.engine.rpc.engine_files import EngineFile, rig_name, running_engines, runtime_folder
from rigctl.engine.rpc.messages import EngineStatus, RunStatus, parse_status
from rigctl.errors import WrongUse
from rigctl.experiments import DRUM_EXPERIMENT
from rigctl.values import SAMPLE_RATE_HZ

if TYPE_CHECKING:
    from rigctl.analysis.cache import Resources
    from rigctl.analysis.encoded_sessions import Encoded
    from rigctl.analysis.report.report_folder import ReportResult
    from rigctl.session.session import Session

PathLike = str | Path
_LOOK_S = 0.02


def connect(rig: PathLike | None = "virtual", *, paced: bool = True, seed: int = 0) -> ConnectedRig:
    """Join the running engine of a rig, or start one.

    ``rig``: virtual, firmware, or the path of a rig.toml; None for the only engine that runs.
    ``paced``: a simulated rig that is started runs in real time, else as fast as it can; ``seed``
    is its seed. Raises WrongUse where no rig or several fit, LinkLost where a board is not there.
    """
    engine = _running_engine(None if rig is None else str(rig))
    if engine is not None:
        return ConnectedRig(EngineClient.join(engine), started=False)
    if rig is None:
        raise WrongUse("no engine is running: name the rig, such as rig.toml")
    return ConnectedRig(EngineClient.start(str(rig), paced=paced, seed=seed), started=True)


def _running_engine(rig: str | None) -> EngineFile | None:
    """Return the engine of this rig, or the only one. Raises WrongUse where several fit."""
    drums = [e for e in running_engines(runtime_folder()) if e.experiment == DRUM_EXPERIMENT]
    fitting = [engine for engine in drums if rig is None or engine.rig == rig_name(rig)]
    if len(fitting) > 1:
        rigs = ", ".join(f"{engine.rig} (process {engine.pid})" for engine in fitting)
        raise WrongUse(f"several engines are running: {rigs}: name one rig, or end one")
    return fitting[0] if fitting else None


class ConnectedRig:
    """A drum with its taxels. Close it, or use it in a ``with`` statement.

    Moves return when they are done. They raise EngineRefusal, whose text says why and what to do,
    for a value outside the rig's limits, during a run, after a fault, or while another client has
    control; LinkLost where the engine has ended. On Ctrl-C call :meth:`stop`.
    """

    def __init__(self, client: EngineClient, *, started: bool) -> None:
        self.client = client
        self._started = started

    def close(self) -> None:
        """Leave the engine; one that was started here lifts and ends, unless others use it."""
        if self._started:
            self.client.leave()
        else:
            self.client.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def status(self) -> EngineStatus:
        """What the rig does now: its state, force in g, speed in mm/s, recording and run."""
        return parse_status(self.client.request("status"))

    def arm(self) -> None:
        """Power up and lift off, unless the drum is armed already."""
        self._move("arm")

    def disarm(self) -> None:
        """Lift off where necessary and switch the drivers off."""
        self._move("disarm")

    def home(self) -> None:
        """Find the index mark and count steps from it; the drum is armed."""
        self._move("home")

    def tare(self) -> None:
        """Take the reading of the load cell, lifted and still, as no load; the drum is armed."""
        self._move("tare")

    def jog(self, mm: float) -> float:
        """Turn the lifted drum, forwards where positive; return the true way of its surface, mm."""
        return float(self._move("jog", mm=mm)["moved_mm"])

    def move_axis(self, height_mm: float) -> float:
        """Move the further axis with the drum off and lifted; return its height, mm."""
        return float(self._move("axis", height_mm=height_mm)["height_mm"])

    def set(self, **settings: float) -> dict[str, float]:
        """Set speed_mm_s, force_g, travel_mm, acceleration_mm_s2 or run_in_mm.

        Returns what the board took.
        """
        return self.client.request("set", **settings)

    def approach(self) -> None:
        """Press until the set force has settled."""
        self._move("approach")

    def turn(self) -> None:
        """Turn under the sensor for the set travel at the set speed, from approach to hold."""
        self._move("run")

    def lift(self) -> None:
        """Lift off from any state."""
        self._move("retract")

    def stop(self) -> None:
        """Stop and lift immediately; a run ends."""
        self.client.request("stop")

    def mount(self, plate: str) -> None:
        """Store which plate is mounted; a simulated rig mounts it itself."""
        self.client.request("plate", texture=plate)

    @contextmanager
    def record(self, out: PathLike, note: str = "") -> Iterator[Path]:
        """Record into a new folder, without trials, until the ``with`` statement ends."""
        made = self.client.request("record", out=_absolute(out), note=note)
        try:
            yield Path(made["session"])
        finally:
            self.client.request("end_record")

    def run(
        self,
        protocol: PathLike,
        out: PathLike,
        *,
        answer: Callable[[str], bool] | None = None,
        tell: Callable[[RunStatus], object] | None = None,
        **options: Any,
    ) -> RunStatus:
        """Run a protocol into a new session and return how it ended.

        ``answer`` is called with each question, such as for a plate, and returns whether to go on;
        without one a simulated rig answers itself, and a real one asks in the window. ``tell``
        gets every status. ``options``: ``seed``, ``operator``, ``sensor``, ``plate_lot``,
        ``project`` and ``remarks``. Ctrl-C ends the run; its session is kept.
        """
        options |= {"protocol": _absolute(find_protocol(str(protocol))), "out": _absolute(out)}
        session = self.client.request("start", yes=answer is None, **options)["session"]
        try:
            return self._watch(session, answer, tell)
        except BaseException:
            self.client.request("abort")
            raise

    def blocks(self, seconds: float | None = None) -> Iterator[TaxelWindow]:
        """Yield the samples with their spikes as they come, from now on, each once.

        ``seconds``: of the rig's samples; None: until the engine ends. Where the script was
        slower than the live memory is long, ``first`` is above the end of the block before.
        """
        live = self.client.live
        seen = live.taxel_head
        end = None if seconds is None else seen + round(seconds * SAMPLE_RATE_HZ)
        while end is None or seen < end:
            self.client.wait(_LOOK_S)
            block = live.taxels_since(seen)
            if len(block):
                seen = block.first + len(block)
                yield block

    def _move(self, command: str, **args: Any) -> dict[str, Any]:
        """Send a request of a move and wait for its end, which the engine bounds."""
        return self.client.request(command, timeout_s=2 * MOVE_TIMEOUT_S, **args)

    def _watch(
        self,
        session: str,
        answer: Callable[[str], bool] | None,
        tell: Callable[[RunStatus], object] | None,
    ) -> RunStatus:
        answered = None
        for run in self._statuses(session):
            if tell is not None:
                tell(run)
            if run.has_ended:
                break
            if answer is not None and run.prompt is not None and run.prompt.id != answered:
                answered = run.prompt.id
                word = "ok" if answer(run.prompt.text) else "abort"
                self.client.request("answer", prompt_id=answered, answer=word)
        return run

    def _statuses(self, session: str) -> Iterator[RunStatus]:
        """Yield the statuses of the run that writes a session, until the link is lost."""
        while True:
            for message in self.client.wait(1.0):
                if message.get("event") == "status":
                    run = parse_status(message["data"]).run
                    if run.session == session:
                        yield run


def open_session(folder: PathLike) -> Session:
    """Open a session for reading; use it in a ``with`` statement. Raises SessionError."""
    from rigctl.session.session import Session

    return Session.open(Path(folder))


def encode(sessions: PathLike | Sequence[PathLike], out: PathLike, **options: Any) -> Encoded:
    """Write the spikes of all trials to ``out/spikes.h5``, as ``rigctl encode`` does.

    ``options``: the command's, with _ for -, such as ``preset`` and ``ranges``, and ``workers``.
    Raises SessionError or WrongUse for what cannot be encoded.
    """
    from rigctl.analysis.encoded_sessions import encode_sessions
    from rigctl.analysis.options import EncoderOptions
    from rigctl.analysis.taxel import EncodeRequest

    with _resources(options) as resources:
        given = EncoderOptions(_paths(sessions), **options)
        request = EncodeRequest(
            given.sessions, given.parameters, settings=given.analysis, ranges=given.taxel_ranges
        )
        return encode_sessions(request, Path(out), _now(), resources)


def analyse(sessions: PathLike | Sequence[PathLike], out: PathLike, **options: Any) -> ReportResult:
    """Write the report of a drum's sessions to the folder ``out``, as ``rigctl analyse`` does.

    ``options``: the command's, with _ for -, such as ``iterations`` and ``task``, and ``workers``.
    Raises SessionError, ConfigError or WrongUse for sessions that cannot be analysed in this way.
    """
    from rigctl.analysis.options import AnalysisOptions
    from rigctl.analysis.report.report_folder import make_report

    with _resources(options) as resources:
        given = AnalysisOptions(_paths(sessions), out=Path(out), **options)
        return make_report(given, _now(), resources)


@contextmanager
def _resources(options: dict[str, Any]) -> Iterator[Resources]:
    """Yield the cache and the workers, whose number is taken out of the options."""
    from rigctl.analysis.cache import Cache, Resources, cache_folder
    from rigctl.analysis.executors import local_executor

    cache = Cache(cache_folder())
    with local_executor(options.pop("workers", 1)) as executor:
        yield Resources(executor, cache)
    cache.trim()


def _paths(sessions: PathLike | Sequence[PathLike]) -> tuple[Path, ...]:
    given = (sessions,) if isinstance(sessions, str | Path) else sessions
    return tuple(map(Path, given))


def _absolute(path: PathLike) -> str:
    """Return a path that means the same to the engine, which runs in another folder."""
    return str(Path(path).absolute())


def _now() -> str:
    return datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
