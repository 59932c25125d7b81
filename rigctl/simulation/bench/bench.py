"""The physical bench that both kinds of boards are wired to: mechanics, skin, load cell, truth."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor

import numpy as np

from rigctl.simulation.bench.contact import contact_tables, footprint, mounted
from rigctl.simulation.bench.ground_truth import GroundTruth
from rigctl.simulation.bench.load_cell import LoadCellAmplifier
from rigctl.simulation.bench.mechanics import DRUM_MM, FORCE_G, RING_MS, Mechanics, RodMotion
from rigctl.simulation.bench.parameters import WorldParameters, checked
from rigctl.simulation.bench.skin import Skin
from rigctl.simulation.simulated_rig import Disturbances
from rigctl.wire.drum.codes import Signal

LOG_EVERY_MS = 1000


class Bench:
    """One simulated bench, the same for a seed. The boards around it move its time.

    ``helper`` may make noise ahead of its time.

    Raises WrongUse when a parameter lies outside its plausible range.
    """

    def __init__(
        self, parameters: WorldParameters, seed: int, helper: Executor | None = None
    ) -> None:
        self.parameters = checked(parameters)
        self.seed = seed
        self.disturbances = Disturbances()
        self.plant = Mechanics(parameters)
        self.skin = Skin(parameters, seed, self.plant, helper)
        self.loadcell = LoadCellAmplifier(parameters, seed, self.plant, self.disturbances)
        self._truth = GroundTruth()
        self.logged_ms = 0
        self._logged_level = 0
        self._plates = 0
        self.sync_level = 0
        self.on_sync: Callable[[int, int], None] | None = None
        self._sync_edges: list[tuple[int, int]] = []
        self.set_plate("A")

    @property
    def truth(self) -> GroundTruth:
        """What really happened, up to now."""
        self.log_truth()
        return self._truth

    def set_plate(self, name: str) -> None:
        """Snap in a plate; it never sits quite as the last one did. Raises WrongUse."""
        tables = contact_tables(name, self.parameters)
        mounting = mounted(self.parameters, self.seed, self._plates)
        self._plates += 1
        self.skin.set_plate(tables, mounting)
        self.plant.set_footprint(footprint(tables, self.parameters, mounting))

    def disturb(self) -> None:
        """Bring changed disturbances to the mechanics."""
        self.plant.disturb(self.disturbances.motor_jammed, self.disturbances.push_g)

    def sync(self, level: int, at_us: int) -> None:
        """The drum board drives its sync pin to this level; ``on_sync(level, at_us)`` hears."""
        if Signal.SYNC in self.disturbances.absent:
            return
        level = level ^ (Signal.SYNC in self.disturbances.inverted)
        if level == self.sync_level:
            return
        self.sync_level = level
        self._sync_edges.append((at_us, level))
        if self.on_sync is not None:
            self.on_sync(level, at_us)

    def advance(self, until_ms: int, drive: float, motion: RodMotion) -> None:
        """As :meth:`Mechanics.advance`, at most 1 s a call; skin and truth follow behind."""
        if until_ms - self.logged_ms > LOG_EVERY_MS:
            self.log_truth()
        self.plant.advance(until_ms, drive, motion)

    def log_truth(self) -> None:
        """Write down what the plant did since the last time."""
        self.skin.advance()
        times_ms = np.arange(self.logged_ms, self.plant.time_ms + 1)
        if times_ms.size == 1:
            return
        did = self.plant.log.take(times_ms % RING_MS, axis=0)  # mode="wrap" counts turn by turn
        sync = np.full(times_ms.size - 1, self._logged_level, np.uint8)
        for at_us, level in self._sync_edges:
            sync[times_ms[1:] * 1000 >= at_us] = level
        self._logged_level = self.sync_level
        self._sync_edges.clear()
        self._truth.append(np.diff(did[:, DRUM_MM]) * 1e3, did[1:, FORCE_G], sync)
        self.logged_ms = self.plant.time_ms
