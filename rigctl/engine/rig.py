"""A rig of any kind, as the engine and the command line use it."""

from __future__ import annotations

import asyncio
from collections.abc import Collection
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rigctl.boards.drum import Drum
from rigctl.boards.taxels import Taxels
from rigctl.config.rig_config import RigConfig
from rigctl.engine.axis import Axis
from rigctl.plugins import Plugin
from rigctl.session.sensor_passport import SensorPassport
from rigctl.values import PluginUse


@dataclass(eq=False, slots=True)
class Rig:
    """Two boards, their event loop, and the description of the bench.

    ``kind``: virtual, firmware or bench. ``seed``: that of a simulated rig. ``simulation``: the
    :class:`rigctl.bench.simulated_rig.SimulatedRig` behind the boards, which the engine must
    not import; None at the bench. ``world``: what a session stores about a simulated rig.
    ``path``: the ``rig.toml`` of a bench, which takes its calibrations. ``commissions``: the drum's
    board is commissioned by this program, because its wires are known to be as drawn.
    ``passport``: of the sensor, None without a calibration. ``axis``: a further one, None without.
    ``sensor_plugin``: what decodes the sensor's board, None for our own.
    """

    kind: str
    description: str
    config: RigConfig
    loop: asyncio.AbstractEventLoop
    drum: Drum
    taxels: Taxels
    seed: int = 0
    simulation: Any = None
    world: dict[str, Any] = field(default_factory=dict)
    path: Path | None = None
    commissions: bool = False
    passport: SensorPassport | None = None
    axis: Axis | None = None
    sensor_plugin: Plugin | None = None

    @property
    def plugins(self) -> tuple[PluginUse, ...]:
        """What a session keeps of the plug-ins of this rig, and of the axis its height now."""
        return tuple(one.used() for one in (self.sensor_plugin, self.axis) if one is not None)

    @property
    def simulated(self) -> bool:
        """True without a real bench."""
        return self.simulation is not None

    @property
    def truth(self) -> Any:
        """What a simulated rig logs that nobody measures, up to now; None at the bench."""
        return self.simulation.truth if self.simulated else None

    @property
    def faults(self) -> Any:
        """The fault injection of a simulated rig; None at the bench."""
        return self.simulation.faults if self.simulated else None

    @property
    def wirings(self) -> tuple[str, ...]:
        """Names of the wrong wirings of a simulated rig that are on; empty at the bench."""
        return tuple(self.simulation.faults.wirings) if self.simulated else ()

    @property
    def plate(self) -> str | None:
        """Texture of a simulated plate; None at the bench, where nobody has said it yet."""
        return str(self.simulation.plate) if self.simulated else None

    def set_plate(self, texture: str) -> bool:
        """Change a simulated plate; False at the bench, where a person has to change it."""
        if self.simulated:
            self.simulation.set_plate(texture)
        return self.simulated

    def skip_mountings(self, count: int) -> None:
        """Give a simulated bench the mountings of earlier sittings; nothing at the bench."""
        if self.simulated:
            self.simulation.skip_mountings(count)

    def lay_mass(self, mass_g: float) -> bool:
        """Load a simulated load cell; False at the bench, where a person has to place the mass."""
        if self.simulated:
            self.simulation.faults.push(mass_g)
        return self.simulated

    def touch_sensor(self, places: Collection[int], unplugged: bool) -> bool:
        """Press places of a simulated sensor; False at the bench, where a person has to.

        ``unplugged``: the bottom layer's read lines are unplugged.
        """
        if self.simulated:
            self.simulation.faults.touch_sensor(places, unplugged)
        return self.simulated

    def answer(self, key: str, amount: float) -> str:
        """Do on a simulated bench what a person is asked; return the answer, empty at the bench.

        ``key`` is that of the question, ``amount`` the number that it is about.
        """
        return str(self.simulation.hands.answer(key, amount)) if self.simulated else ""

    def close(self) -> None:
        """Free ports and boards, then close the loop unless it is running."""
        self.drum.close()
        self.taxels.close()
        if self.axis is not None:
            self.axis.close()
        if self.simulated:
            self.simulation.close()
        if not self.loop.is_running():
            self.loop.close()
