"""A rig of the moving finger, real or simulated, as the engine uses it."""

from __future__ import annotations

import asyncio
from collections.abc import Collection
from dataclasses import dataclass, field
from typing import Any

from rigctl.finger.config import FingerConfig
from rigctl.finger.driver import Finger
from rigctl.finger.trackers.plate_frame import PlateFrame
from rigctl.finger.trackers.tracker import Tracker
from rigctl.finger.values import FingerTrial
from rigctl.plugins import Plugin
from rigctl.session.sensor_passport import SensorPassport


@dataclass(eq=False, slots=True)
class FingerRig:
    """The finger board, the tracker, the place of the plate, and the event loop of all.

    ``kind``: virtual, firmware or bench. ``simulation``: the virtual finger behind board and
    tracker, which the engine must not import; None where a person moves the finger. ``world``:
    what a session stores about a simulated rig. ``passport``: of the sensor, None without one.
    ``plugin``: what the tracker is from, None for one of ours.
    """

    kind: str
    description: str
    config: FingerConfig
    loop: asyncio.AbstractEventLoop
    finger: Finger
    tracker: Tracker
    frame: PlateFrame
    seed: int = 0
    simulation: Any = None
    world: dict[str, Any] = field(default_factory=dict)
    passport: SensorPassport | None = None
    plugin: Plugin | None = None

    @property
    def simulated(self) -> bool:
        """True without a person and a real board."""
        return self.simulation is not None

    @property
    def truth(self) -> Any:
        """What a simulated rig logs that nobody measures; None at a real one."""
        return self.simulation.truth if self.simulated else None

    @property
    def faults(self) -> Any:
        """The fault injection of a simulated rig; None at a real one."""
        return self.simulation.faults if self.simulated else None

    def check_plates(self, textures: Collection[str]) -> None:
        """Raise WrongUse for a plate that a simulated operator does not have."""
        if self.simulated:
            for texture in textures:
                self.simulation.check_plate(texture)

    def slide(self, trial: FingerTrial) -> bool:
        """Let a simulated operator make the slide; False where a person has to make it."""
        if self.simulated:
            self.simulation.slide(trial.texture, trial.profile)
        return self.simulated

    @property
    def sliding(self) -> bool:
        """Whether a simulated operator has not finished the slide."""
        return self.simulated and bool(self.simulation.sliding)

    def close(self) -> None:
        """Free board and tracker, then close the loop unless it is running."""
        self.finger.close()
        self.tracker.close()
        if self.simulated:
            self.simulation.close()
        if not self.loop.is_running():
            self.loop.close()
