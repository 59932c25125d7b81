"""Start or join the engine that a user names: of the drum rig, or of the moving finger."""

from __future__ import annotations

from typing import NamedTuple

from rigctl.acquisition.rpc.client import FINGER_ENGINE_COMMAND, EngineClient
from rigctl.acquisition.rpc.engine_files import (
    DRUM_EXPERIMENT,
    FINGER_EXPERIMENT,
    EngineFile,
    running_engines,
)
from rigctl.acquisition.rpc.runtime_folder import runtime_folder

JOIN = "join"
SIMULATED = ("virtual", "firmware")


class FingerEngineSpec(NamedTuple):
    """An engine of the moving finger.

    ``seed``, ``session`` and ``first_slide`` define the person and the sensor of a simulated rig.
    """

    rig: str
    seed: int = 0
    session: int = 0
    first_slide: int = 0


def open_client(rig: str, world: str = "") -> EngineClient:
    """Start or join an engine and return its client. Raises what prevents that.

    ``JOIN`` joins the newest running engine. A bench has one engine: if it already runs, this
    joins it. Simulated rigs can run several engines, each with the ``world`` of a file.
    """
    if rig == JOIN:
        return EngineClient.attach()
    if world:
        return EngineClient.start(rig, run=["--world", world])
    if rig not in SIMULATED and (engine := _running(rig, DRUM_EXPERIMENT)) is not None:
        return EngineClient(engine)
    return EngineClient.start(rig)


def open_finger_client(spec: FingerEngineSpec) -> EngineClient:
    """Start or join an engine of the moving finger, as :func:`open_client`.

    ``JOIN`` joins the newest one, whatever its seed and session. A simulated rig runs in real time.
    """
    if spec.rig == JOIN:
        return EngineClient.attach(FINGER_EXPERIMENT)
    if spec.rig not in SIMULATED:
        if (engine := _running(spec.rig, FINGER_EXPERIMENT)) is not None:
            return EngineClient(engine)
        return EngineClient.start(spec.rig, command=FINGER_ENGINE_COMMAND)
    person = ["--session", str(spec.session), "--first-slide", str(spec.first_slide)]
    return EngineClient.start(spec.rig, seed=spec.seed, run=person, command=FINGER_ENGINE_COMMAND)


def _running(rig: str, experiment: str) -> EngineFile | None:
    """Return the running engine of a rig, None without one."""
    for engine in running_engines(runtime_folder()):
        if (engine.rig, engine.experiment) == (rig, experiment):
            return engine
    return None
