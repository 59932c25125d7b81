"""The part of a rig that the engine uses.

:class:`rigctl.rig.Rig` is the one implementation. It opens the simulation as well, which the
engine must not import, so the engine knows this interface only.
"""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any, Protocol

from rigctl.config.rig_config import RigConfig
from rigctl.devices.drum import Drum
from rigctl.devices.taxels import Taxels


class RigInterface(Protocol):
    """Two boards and the loop whose clock they follow.

    ``kind``: virtual, firmware or bench. ``world``: parameters of a simulated world for the
    session, by name, empty at a real rig.
    """

    loop: asyncio.AbstractEventLoop
    drum: Drum
    taxels: Taxels
    kind: str
    config: RigConfig
    description: str
    world: dict[str, Any]

    @property
    def simulated(self) -> bool:
        """Whether the boards are simulated."""
        ...

    @property
    def faults(self) -> Any:
        """Fault injection of a simulated rig, None at a real one."""
        ...

    def set_plate(self, texture: str) -> bool:
        """Mount a plate; return False where a person must do it."""
        ...

    def save_truth(self, folder: Path) -> None:
        """Store the ground truth of a simulated world; do nothing at a real rig."""
        ...
