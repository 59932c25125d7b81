"""Start or join the engine that a user names: of the drum rig, or of the moving finger."""

from __future__ import annotations

from typing import NamedTuple

from rigctl.acquisition.rpc.client import (
    FINGER_ENGINE_COMMAND,
    EngineClient,
    FoundEngine,
    find_engines,
)
from rigctl.acquisition.rpc.engine_files import (
    DRUM_EXPERIMENT,
    FINGER_EXPERIMENT,
    EngineFile,
    rig_name,
    running_engines,
    runtime_folder,
)
from rigctl.errors import WrongUse

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
