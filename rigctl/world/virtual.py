"""The virtual rig: the bench with two boards that are Python objects."""

from __future__ import annotations

from rigctl.wire.drum_map import Signal
from rigctl.world.bench import Bench
from rigctl.world.parameters import WorldParameters
from rigctl.world.simulation import DRUM, TAXELS, FaultPanel, SimulatedLink
from rigctl.world.truth import Truth
from rigctl.world.virtual_drum import VirtualDrum
from rigctl.world.virtual_taxels import VirtualTaxels

SLICE_US = 20_000


def open_virtual(parameters: WorldParameters | None = None, seed: int = 0) -> VirtualRig:
    """A virtual rig at power-up, the same for a seed.

    Raises WrongUse when a parameter lies outside its plausible range.
    """
    return VirtualRig(Bench(parameters or WorldParameters(), seed))


class VirtualRig:
    """A :class:`~rigctl.world.simulation.Simulation` that goes from event to event.

    ``taxels``: another taxel board than the one on this rig's cable.
    """

    def __init__(self, bench: Bench, taxels: VirtualTaxels | None = None) -> None:
        self.time_us = 0
        self._bench = bench
        self.drum = SimulatedLink(DRUM, 2 * bench.seed)
        self.taxels = SimulatedLink(TAXELS, 2 * bench.seed + 1)
        self._drum = VirtualDrum(bench, self.drum)
        self._taxels = taxels or VirtualTaxels(bench, self.taxels)
        bench.on_sync = self._taxels.sync_edge
        links = {DRUM: self.drum, TAXELS: self.taxels}
        self.faults = FaultPanel(links, bench.disturbances, self._disturb, self._reset)

    @property
    def truth(self) -> Truth:
        """What really happened, up to now."""
        return self._bench.truth

    @property
    def slice_us(self) -> int:
        """Longest useful advance from now, µs."""
        return max(1, int(min(SLICE_US, self._drum.next_wire_us - self.time_us)))

    def advance(self, until_us: int) -> None:
        """Run world and boards up to a world time."""
        while self._go_on(until_us):
            pass

    def set_plate(self, texture: str) -> None:
        """Snap in the plate of texture ``"A"``–``"P"``. Raises WrongUse for another name."""
        self._bench.set_plate(texture)

    def close(self) -> None:
        """Close both cables."""
        self.drum.close()
        self.taxels.close()

    def _go_on(self, until_us: int) -> bool:
        """Up to the next event; False where there is none until then and the time has come."""
        cell_us, drum_us = self._bench.loadcell.next_us, self._drum.next_us
        taxels_us = self._taxels.next_us
        due_us = min(drum_us, cell_us, taxels_us)
        at_us = max(self.time_us, int(min(due_us, until_us)))
        if at_us // 1000 > self._bench.plant.time_ms and self._mechanics(at_us // 1000):
            return True
        self.time_us = self._drum.now_us = at_us
        if due_us > at_us:
            return False
        if at_us >= cell_us:
            self._convert(at_us)
        if at_us >= drum_us:
            self._drum.pass_time(at_us)
        if at_us >= taxels_us:
            self._taxels.pass_time(at_us)
        return True

    def _mechanics(self, until_ms: int) -> bool:
        """Run the plant; True when it stopped early and the boards were told why."""
        plant = self._bench.plant
        marks = plant.index_rises
        low, high = self._drum.limits_mm
        stopped = self._bench.advance(until_ms, self._drum.duty, self._drum.motion, low, high)
        if stopped:
            self._stopped(marks)
        return stopped

    def _stopped(self, marks: int) -> None:
        """Tell the boards why the plant stopped; there were so many index marks before."""
        plant, (low, high) = self._bench.plant, self._drum.limits_mm
        if plant.index_rises > marks and Signal.INDEX not in self._bench.disturbances.absent:
            self._taxels.index_mark(plant.index_rise_us)
            self._drum.controller.index_mark(plant.index_rise_us)
        if plant.rod_mm <= low or plant.rod_mm >= high:
            self._drum.controller.limit_reached(plant.time_ms * 1000)

    def _convert(self, at_us: int) -> None:
        raw = self._bench.loadcell.convert()
        if raw is not None:
            self._drum.controller.conversion(at_us, raw)

    def _disturb(self) -> None:
        self._bench.disturb()
        self._drum.controller.estop_changed(self.time_us)

    def _reset(self, board: str) -> None:
        if board == DRUM:
            self._drum.reset(self.time_us)
        else:
            self._taxels.reset(self.time_us)
