"""A bench whose chips start in the factory bootloaders of the boards."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine, Mapping
from pathlib import Path
from typing import Any

from rigctl.bench.chips.rig import ChipSimulation, open_chip_simulation
from rigctl.bench.clock import SimulatedTimeLoop
from rigctl.bench.parameters import WorldParameters
from rigctl.boards.drum import Drum
from rigctl.boards.taxels import Taxels
from tests.firmware.building import built


class BootBench:
    """A bench of chips with bootloaders, and both drivers, in simulated time."""

    def __init__(
        self, bootloaders: Mapping[str, Path], drum_image: str = "firmware/drum.elf"
    ) -> None:
        built("sim/libchips.so")
        images = built(drum_image), built("firmware/taxels.elf")
        simulation = open_chip_simulation(WorldParameters(), 1, *images, bootloaders)
        assert isinstance(simulation, ChipSimulation)
        self.simulation = simulation
        self.loop = SimulatedTimeLoop(simulation)
        self.drum = Drum(simulation.drum, self.loop)
        self.taxels = Taxels(simulation.taxels, self.loop)

    def run(self, main: Callable[[BootBench], Coroutine[Any, Any, None]]) -> None:
        """Run ``main`` and close everything."""
        asyncio.set_event_loop(self.loop)
        try:
            self.loop.run_until_complete(main(self))
        finally:
            self.drum.close()
            self.taxels.close()
            asyncio.set_event_loop(None)
            self.loop.close()
            self.simulation.close()
