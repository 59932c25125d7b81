"""One way to open every rig: boards and clock, and nobody else knows which kind it is.

A rig is two boards on two links and the loop whose clock they live by. At the bench the links
are ports and the clock is the wall's; on a simulated rig both come from the simulation.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rigctl.config.resources import firmware_image
from rigctl.config.rig_config import RigConfig, load_config
from rigctl.devices.drum import Drum
from rigctl.devices.port_discovery import DRUM, TAXELS, ask, find_boards, open_link
from rigctl.devices.taxels import Taxels
from rigctl.errors import ConfigError, LinkLost, RigFault, WrongUse
from rigctl.values import N_TAXELS, BoardIdentity
from rigctl.wire.drum.codes import Signal

if TYPE_CHECKING:
    from rigctl.simulation.bench.world_file import SimulatedWorld
    from rigctl.simulation.simulated_rig import FaultInjection, SimulatedRig

VIRTUAL, FIRMWARE, BENCH = "virtual", "firmware", "bench"
OTHER = {DRUM: TAXELS, TAXELS: DRUM}


class Rig:
    """Two boards, the loop they live by, and what is known of the bench around them.

    ``kind`` is virtual, firmware or bench. ``faults`` makes things go wrong on a simulated
    rig, and is None at the bench. ``world`` is what a session keeps of a simulated one.
    """

    def __init__(
        self,
        kind: str,
        description: str,
        config: RigConfig,
        loop: asyncio.AbstractEventLoop,
        drum: Drum,
        taxels: Taxels,
        simulation: SimulatedRig | None = None,
        world: dict[str, Any] | None = None,
    ) -> None:
        self.kind = kind
        self.description = description
        self.config = config
        self.loop = loop
        self.drum = drum
        self.taxels = taxels
        self.simulation = simulation
        self.world = world or {}

    @property
    def simulated(self) -> bool:
        """True where no bench stands behind the boards."""
        return self.simulation is not None

    @property
    def faults(self) -> FaultInjection | None:
        """What can be made to go wrong; None at the bench."""
        return self.simulation.faults if self.simulation else None

    def set_plate(self, texture: str) -> bool:
        """True where the plate changed by itself, False where a person has to change it."""
        if self.simulation is None:
            return False
        self.simulation.set_plate(texture)
        return True

    def lay_mass(self, mass_g: float) -> bool:
        """True where the load cell now feels that mass by itself, False where a person lays it."""
        if self.simulation is None:
            return False
        self.simulation.faults.push(mass_g)
        return True

    def save_truth(self, folder: Path) -> None:
        """Add to a session what the simulated world logged since the last call; nothing else."""
        if self.simulation is not None:
            from rigctl.session.files.ground_truth import write_truth

            write_truth(folder, self.simulation.truth.take())

    def close(self) -> None:
        """Free ports and boards, then the loop, unless it still runs."""
        self.drum.close()
        self.taxels.close()
        if self.simulation is not None:
            self.simulation.close()
        if not self.loop.is_running():
            self.loop.close()


def open_rig(
    spec: str,
    *,
    seed: int = 0,
    paced: bool = True,
    config: RigConfig | None = None,
    world: SimulatedWorld | None = None,
) -> Rig:
    """Open ``virtual``, ``firmware``, or the rig that a ``rig.toml`` describes.

    ``seed`` and ``world`` shape a simulated bench; ``paced`` keeps it to real time. Without a
    ``config`` the description of ``virtual`` and ``firmware`` fits the world. Opening
    asks no board anything: ``rig.drum.connect()`` and ``rig.taxels.connect()`` do. Raises
    WrongUse for a rig that does not exist or cannot have a world, ConfigError for a description
    that cannot be used.
    """
    if spec in (VIRTUAL, FIRMWARE):
        return _simulated_rig(spec, seed, paced, config, world)
    path = Path(spec)
    if not path.is_file():
        raise WrongUse(f"there is no rig {spec}: give virtual, firmware, or a rig.toml")
    described = _fitting(config or load_config(path))
    if described.ports.simulate:
        return _simulated_rig(described.ports.simulate, seed, paced, described, world)
    if world is not None:
        raise WrongUse(
            f"{path} describes a real rig, which has no world file: leave --world out, or set "
            "[ports] simulate to rehearse"
        )
    return _bench(path, described)


def _fitting(config: RigConfig) -> RigConfig:
    """The description, where it is one of a sensor that the taxel board can read."""
    if config.taxels.count != N_TAXELS:
        raise ConfigError(
            f"{config.about.name}: [taxels] count is {config.taxels.count}, the taxel board reads "
            f"{N_TAXELS}: leave count out"
        )
    return config


def _simulated_rig(
    kind: str, seed: int, paced: bool, config: RigConfig | None, world: SimulatedWorld | None
) -> Rig:
    from rigctl.simulation.bench.world_file import NOMINAL
    from rigctl.simulation.clock import SimulatedTimeLoop
    from rigctl.simulation.virtual_rig import warm

    world = world or NOMINAL
    config = _fitting(config or world.description())
    warm()
    _check_stop(config)
    simulation = _open_simulation(kind, seed, world)
    _wire_as_described(simulation, config)
    loop = SimulatedTimeLoop(simulation, 1.0 if paced else None)
    return Rig(
        kind,
        f"simulated bench, {kind} boards, seed {seed}",
        config,
        loop,
        Drum(simulation.drum, loop),
        Taxels(simulation.taxels, loop, array=config.taxels),
        simulation,
        world.facts(),
    )


def _check_stop(config: RigConfig) -> None:
    """Raise ConfigError for an emergency stop that closes when it is pressed.

    No board in its default state takes such a stop for one at rest.
    """
    if config.inverted.estop:
        raise ConfigError(
            f"{config.about.name}: a simulated rig's emergency stop opens when it is pressed: "
            "leave [inverted] estop out"
        )


def _wire_as_described(simulation: SimulatedRig, config: RigConfig) -> None:
    """The simulated bench has the wires that the description says, the way round that it says.

    A rig without an emergency stop has its wire jumpered to ground, as arduino/README.md says.
    """
    fitted = [signal for signal in Signal if getattr(config.signals, signal.name.lower())]
    absent = set(Signal) - {Signal.ESTOP, *fitted}
    inverted = [signal for signal in Signal if getattr(config.inverted, signal.name.lower())]
    if absent or inverted:
        simulation.faults.rewire(absent, inverted)


def _open_simulation(kind: str, seed: int, world: SimulatedWorld) -> SimulatedRig:
    if kind == VIRTUAL:
        from rigctl.simulation.virtual_rig import open_virtual

        return open_virtual(world.parameters, seed)
    images = firmware_image(DRUM), firmware_image(TAXELS)
    from rigctl.simulation.chips.rig import open_chips

    return open_chips(world.parameters, seed, *images)


def _bench(path: Path, config: RigConfig) -> Rig:
    loop = asyncio.SelectorEventLoop()
    try:
        ports = _ports(config, loop)
        drum = Drum(
            open_link(ports[DRUM], DRUM, loop), loop, _whos_there(path, ports[DRUM], DRUM, loop)
        )
        taxels = Taxels(
            open_link(ports[TAXELS], TAXELS, loop),
            loop,
            _whos_there(path, ports[TAXELS], TAXELS, loop),
            config.taxels,
        )
    except BaseException:
        loop.close()
        raise
    return Rig(BENCH, config.about.name, config, loop, drum, taxels)


def _ports(config: RigConfig, loop: asyncio.AbstractEventLoop) -> dict[str, str]:
    """The two ports; those that the description leaves out are found by asking."""
    ports = {DRUM: config.ports.drum, TAXELS: config.ports.taxels}
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


def _whos_there(
    path: Path, port: str, board: str, loop: asyncio.AbstractEventLoop
) -> Callable[[], Awaitable[str]]:
    """Asks, after ``board`` did not answer on ``port``, whether the other one does."""
    return partial(_stranger, path, port, OTHER[board], loop)


async def _stranger(path: Path, port: str, other: str, loop: asyncio.AbstractEventLoop) -> str:
    try:
        identity: BoardIdentity = await ask(port, other, loop)
    except RigFault:
        return ""
    return f"{port}: the {identity.board} board answers there: swap the ports in {path}"
