"""Open any rig of the moving finger, real or simulated, behind one interface."""

from __future__ import annotations

import asyncio
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rigctl.boards.bench_loop import BenchLoop
from rigctl.boards.identity import WHICH_PORT
from rigctl.boards.links import ByteLink
from rigctl.boards.port_discovery import create_link, find_boards, identify_board
from rigctl.config.text_file import read_text
from rigctl.config.toml_reader import MAX_BYTES
from rigctl.errors import ConfigError, LinkLost, WrongUse
from rigctl.finger.board_messages import N_TAXELS
from rigctl.finger.config import FingerConfig, load_finger_config
from rigctl.finger.driver import Finger
from rigctl.finger.rig import FingerRig
from rigctl.finger.trackers.open_tracker import TRACKERS, open_tracker
from rigctl.finger.trackers.plate_frame import PlateFrame, fit_plate_frame
from rigctl.finger.trackers.tracker import Tracker
from rigctl.session.sensor_passport import load_passport
from rigctl.values import FINGER, TAXELS

if TYPE_CHECKING:
    from rigctl.bench.world_file import SimulatedWorld

VIRTUAL, FIRMWARE, BENCH = "virtual", "firmware", "bench"
SIMULATED = (VIRTUAL, FIRMWARE)


def open_finger_rig(
    spec: str,
    *,
    seed: int = 0,
    session: int = 0,
    first_slide: int = 0,
    paced: bool = True,
    world: SimulatedWorld | None = None,
) -> FingerRig:
    """Open ``virtual``, ``firmware``, or the rig that a ``finger.toml`` describes.

    ``seed``, ``session`` and ``world`` define a simulated person, sensor and plates, and
    ``first_slide`` continues an earlier run; ``paced`` runs it in real time. Board and tracker are
    not connected. Raises WrongUse for a rig that does not exist or cannot have a world,
    ConfigError for an unusable description.
    """
    if spec in SIMULATED:
        return _simulated(spec, seed, session, first_slide, paced, world)
    path = Path(spec)
    if not path.is_file():
        raise WrongUse(
            f"there is no rig {spec}: give virtual, firmware, or the path of a finger.toml"
        )
    if world is not None:
        raise WrongUse(f"{path} describes a real rig, which has no world file: leave --world out")
    return _real(path, load_finger_config(path))


def _simulated(
    kind: str,
    seed: int,
    session: int,
    first_slide: int,
    paced: bool,
    world: SimulatedWorld | None,
) -> FingerRig:
    from rigctl.bench.clock import SimulatedTimeLoop
    from rigctl.bench.world_file import NOMINAL_WORLD
    from rigctl.finger.bench.calibration import sensor_passport
    from rigctl.finger.bench.operator_parameters import OperatorParameters, TrackerParameters
    from rigctl.finger.bench.qemu import open_qemu_finger
    from rigctl.finger.bench.virtual import (
        compile_finger_kernels,
        open_virtual_finger,
    )

    if paced:
        compile_finger_kernels()
    world = world or NOMINAL_WORLD
    operator, tracker = OperatorParameters(), TrackerParameters()
    open_finger = open_virtual_finger if kind == VIRTUAL else open_qemu_finger
    simulation = open_finger(
        world.parameters, operator, seed, session, tracker=tracker, first_slide=first_slide
    )
    loop = SimulatedTimeLoop(simulation, 1.0 if paced else None)
    described: dict[str, Any] = {
        **world.header_fields(),
        "session": session,
        "operator": asdict(operator),
        "tracker": asdict(tracker),
    }
    return FingerRig(
        kind,
        f"simulated finger, {kind} board, seed {seed}, session {session}",
        FingerConfig(),
        loop,
        Finger(simulation.finger, loop),
        simulation.tracker,
        fit_plate_frame(simulation.touch_corners()),
        seed,
        simulation,
        described,
        sensor_passport(world.parameters, seed),
    )


def _real(path: Path, config: FingerConfig) -> FingerRig:
    frame, named = _plate_frame(path, config), config.finger.passport
    passport = load_passport(path.parent / named, N_TAXELS) if named else None
    loop = BenchLoop()
    try:
        port = config.finger.port or loop.run_until_complete(find_boards(loop)).get(FINGER, "")
        if not port:
            raise LinkLost(
                "no port answered as the finger board: plug it in; rigctl ports lists what is there"
            )
        diagnose_port = partial(_diagnose_port, path, loop)
        finger = Finger(create_link(port, FINGER, loop), loop, diagnose_port)
        tracker = configured_tracker(path, config, loop)
        plugin = TRACKERS.plugin(config.tracker.source.partition(":")[0])
    except BaseException:
        loop.close()
        raise
    return FingerRig(
        BENCH,
        config.about.name,
        config,
        loop,
        finger,
        tracker,
        frame,
        passport=passport,
        plugin=plugin,
    )


def configured_tracker(
    path: Path, config: FingerConfig, loop: asyncio.AbstractEventLoop
) -> Tracker:
    """Return the tracker, not yet open, that a ``finger.toml`` names. Raises ConfigError."""
    try:
        return open_tracker(config.tracker.source, loop)
    except WrongUse as error:
        raise ConfigError(f"{path}: tracker.source: {error}") from error


async def _diagnose_port(path: Path, loop: asyncio.AbstractEventLoop, link: ByteLink) -> str:
    """Return a sentence where the taxel board answers at ``link``, empty where it does not."""
    if await identify_board(link, TAXELS, loop) is None:
        return ""
    return (
        f"{link.name}: the taxel board answers there, not the finger board: correct [finger] port "
        f"in {path}, or leave it out; {WHICH_PORT}"
    )


def _plate_frame(path: Path, config: FingerConfig) -> PlateFrame:
    """Return the place of the plate. Raises ConfigError without one."""
    if not config.tracker.frame:
        raise ConfigError(
            f"{path}: tracker.frame is missing: touch the plate's corners with "
            "`rigctl realtime frame`, which writes it"
        )
    file = path.parent / config.tracker.frame
    try:
        text = read_text(file, MAX_BYTES, ConfigError)
    except ConfigError as error:
        raise ConfigError(
            f"the plate's frame: {error}; touch the corners with `rigctl realtime frame`, which "
            "writes it"
        ) from error
    return PlateFrame.from_toml(text, str(file))
