"""Open any rig, real or simulated, behind one interface.

A rig is two boards on two links and the event loop whose clock they share. At the bench the
links are ports and the clock is real time; on a simulated rig both come from the simulation.
"""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from rigctl.boards.bench_loop import BenchLoop
from rigctl.boards.drum import Drum
from rigctl.boards.drum_codes import Signal
from rigctl.boards.links import ByteLink
from rigctl.boards.port_discovery import create_link, find_boards, identify_board
from rigctl.boards.sensor_driver import OUR_WIRE, SensorDriver, load_sensor
from rigctl.boards.taxels import Taxels
from rigctl.config.resources import firmware_image
from rigctl.config.rig_config import PAPER_ARRAY, RigConfig, TaxelArray, load_config
from rigctl.config.text_file import is_plain_file, shorten
from rigctl.engine.axis import open_axis
from rigctl.engine.rig import Rig
from rigctl.errors import ConfigError, LinkLost, WrongUse
from rigctl.session.sensor_passport import SensorPassport, load_passport
from rigctl.values import DRUM, TAXELS

if TYPE_CHECKING:
    from rigctl.bench.simulated_rig import SimulatedRig
    from rigctl.bench.world_file import SimulatedWorld

VIRTUAL, FIRMWARE, BENCH = "virtual", "firmware", "bench"


def open_rig(
    spec: str,
    *,
    seed: int = 0,
    paced: bool = True,
    config: RigConfig | None = None,
    world: SimulatedWorld | None = None,
    wirings: Sequence[str] = (),
) -> Rig:
    """Open ``virtual``, ``firmware``, or the rig that a ``rig.toml`` describes.

    ``seed``, ``world`` and ``wirings``, names of the catalogue of
    :mod:`rigctl.bench.wirings`, define a simulated bench; ``paced`` runs it in real time. The
    default ``config`` of ``virtual`` and ``firmware`` is that of the world. The boards are not
    connected: use ``rig.drum.connect()`` and ``rig.taxels.connect()``. Raises WrongUse for a rig
    that does not exist or cannot have a world or wirings, and for an unknown wiring, ConfigError
    for an unusable description.
    """
    if spec in (VIRTUAL, FIRMWARE):
        return _simulated_rig(spec, seed, paced, config, world, wirings)
    path = Path(spec)
    if not is_plain_file(path):
        raise WrongUse(
            f"there is no rig {shorten(spec)}: give virtual, firmware, or the path of a rig.toml"
        )
    config = config or load_config(path)
    passport, config = sensor_passport(path, config)
    if config.ports.simulate:
        rig = _simulated_rig(config.ports.simulate, seed, paced, config, world, wirings)
        rig.passport = passport
        return rig
    if world is not None:
        raise WrongUse(
            f"{path} describes a real rig, which has no world file: leave --world out, or set "
            "[ports] simulate to rehearse"
        )
    if wirings:
        raise WrongUse(
            f"{path} describes a real rig, which is wired as it is: leave --wire out, or set "
            "[ports] simulate to rehearse"
        )
    rig = _bench(path, config)
    rig.passport = passport
    return rig


def sensor_passport(path: Path, config: RigConfig) -> tuple[SensorPassport | None, RigConfig]:
    """Return the passport that a ``rig.toml`` names, and the description with its full path.

    A session keeps the description, and is continued from another folder. Raises ConfigError.
    """
    taxels = config.taxels
    if not taxels.passport:
        return None, config
    file = (path.parent / taxels.passport).resolve()
    named = replace(config, taxels=replace(taxels, passport=str(file)))
    return load_passport(file, taxels.count), named


def _simulated_rig(
    kind: str,
    seed: int,
    paced: bool,
    config: RigConfig | None,
    world: SimulatedWorld | None,
    wirings: Sequence[str],
) -> Rig:
    from rigctl.bench.clock import SimulatedTimeLoop
    from rigctl.bench.virtual_rig import compile_kernels
    from rigctl.bench.wirings import find_wiring
    from rigctl.bench.world_file import NOMINAL_WORLD

    known = [find_wiring(name).name for name in wirings]
    world = world or NOMINAL_WORLD
    config = config or world.rig_config()
    _validate_emergency_stop(config)
    driver = load_sensor(config)
    if kind == FIRMWARE:
        _validate_chips_sensor(config)
    compile_kernels(config.taxels, driver)
    simulation = _open_simulation(kind, seed, world, config.taxels, driver)
    _wire_signals(simulation, config)
    for name in known:
        simulation.faults.wire(name)
    loop = SimulatedTimeLoop(simulation, 1.0 if paced else None)
    return Rig(
        kind,
        f"simulated bench, {kind} boards, seed {seed}",
        config,
        loop,
        Drum(simulation.drum, loop),
        Taxels(simulation.taxels, loop, array=config.taxels, driver=driver),
        seed,
        simulation,
        world.header_fields(),
        commissions=not known,
        axis=open_axis(config.axis, loop, simulated=True),
        sensor_plugin=None if driver is None else driver.plugin,
    )


def _validate_emergency_stop(config: RigConfig) -> None:
    """Raise ConfigError for an emergency stop that closes when it is pressed.

    A board with default settings would see such a stop as pressed.
    """
    if config.inverted.estop:
        raise ConfigError(
            f"{config.about.name}: a simulated rig's emergency stop opens when it is pressed: "
            "leave [inverted] estop out"
        )


def _validate_chips_sensor(config: RigConfig) -> None:
    """Raise ConfigError for another sensor than the one that ``arduino/sim`` wires to its chip."""
    chips = replace(config.taxels, **{n: getattr(PAPER_ARRAY, n) for n in _CHIPS_SENSOR})
    if config.taxels != chips:
        raise ConfigError(
            f"{config.about.name}: the simulated chips have three lines × six inputs: "
            'set [ports] simulate = "virtual" for another sensor'
        )


_CHIPS_SENSOR = "count", "inputs", "driver"


def _wire_signals(simulation: SimulatedRig, config: RigConfig) -> None:
    """Wire the simulated bench with the signals and polarities of the description.

    A rig without an emergency stop has its input jumpered to ground (arduino/README.md).
    """
    fitted = [signal for signal in Signal if getattr(config.signals, signal.name.lower())]
    absent = set(Signal) - {Signal.ESTOP, *fitted}
    inverted = [signal for signal in Signal if getattr(config.inverted, signal.name.lower())]
    if absent or inverted:
        simulation.faults.rewire(absent, inverted)


def _open_simulation(
    kind: str,
    seed: int,
    world: SimulatedWorld,
    sensor: TaxelArray,
    driver: SensorDriver | None,
) -> SimulatedRig:
    if kind == VIRTUAL:
        from rigctl.bench.virtual_rig import open_virtual_rig

        return open_virtual_rig(world.parameters, seed, sensor=sensor, driver=driver)
    images = firmware_image(DRUM), firmware_image(TAXELS)
    from rigctl.bench.chips.rig import open_chip_simulation

    return open_chip_simulation(world.parameters, seed, *images, sensor=sensor)


def _bench(path: Path, config: RigConfig) -> Rig:
    driver = load_sensor(config)
    loop = BenchLoop()
    try:
        ports = _find_ports(config, loop)
        drum_link = create_link(ports[DRUM], DRUM, loop)
        baud = None if driver is None else driver.create.baud
        taxel_link = create_link(ports[TAXELS], TAXELS, loop, baud)
        drum = Drum(drum_link, loop, partial(_diagnose_port, path, TAXELS, loop))
        diagnose_taxel_port = partial(_diagnose_port, path, DRUM, loop)
        taxels = Taxels(taxel_link, loop, diagnose_taxel_port, config.taxels, driver)
        axis = open_axis(config.axis, loop, simulated=False)
    except BaseException:
        loop.close()
        raise
    return Rig(
        BENCH,
        config.about.name,
        config,
        loop,
        drum,
        taxels,
        path=path.resolve(),
        axis=axis,
        sensor_plugin=None if driver is None else driver.plugin,
    )


def _find_ports(config: RigConfig, loop: asyncio.AbstractEventLoop) -> dict[str, str]:
    """Return the two ports; probes all ports for the boards whose port is not configured."""
    ports = {DRUM: config.ports.drum, TAXELS: config.ports.taxels}
    if config.taxels.driver != OUR_WIRE and not config.ports.taxels:
        raise ConfigError(
            f"{config.about.name}: a search finds no board of the sensor {config.taxels.driver}: "
            "name its port, [ports] taxels"
        )
    if not all(ports.values()):
        found = loop.run_until_complete(find_boards(loop))
        ports = {board: port or found.get(board, "") for board, port in ports.items()}
    for board, port in ports.items():
        if not port:
            raise LinkLost(
                f"no port answered as the {board} board: plug it in; "
                "rigctl ports lists what is there"
            )
    return ports


async def _diagnose_port(
    path: Path, other_board: str, loop: asyncio.AbstractEventLoop, link: ByteLink
) -> str:
    """Return a sentence where the other board answers at ``link``, empty where it does not."""
    identity = await identify_board(link, other_board, loop)
    if identity is None:
        return ""
    return f"{link.name}: the {identity.board} board answers there: swap the ports in {path}"
