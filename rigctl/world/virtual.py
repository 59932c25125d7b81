"""The virtual rig: the bench with two boards that are Python objects."""

from __future__ import annotations

from functools import cache

from rigctl.wire.drum_map import Signal
from rigctl.world.bench import Bench
from rigctl.world.parameters import WorldParameters
from rigctl.world.press_kernel import DONE, SETTLED_NOW, STOPPED, TOUCHED
from rigctl.world.simulation import DRUM, TAXELS, FaultPanel, SimulatedLink
from rigctl.world.stretch import Stretch
from rigctl.world.truth import Truth
from rigctl.world.virtual_drum import VirtualDrum
from rigctl.world.virtual_taxels import VirtualTaxels

SLICE_US = 20_000
WARM_US = 300_000
"""By then the boards have booted, the load cell speaks and frames were sent."""


def open_virtual(parameters: WorldParameters | None = None, seed: int = 0) -> VirtualRig:
    """A virtual rig at power-up, the same for a seed.

    Raises WrongUse when a parameter lies outside its plausible range.
    """
    return VirtualRig(Bench(parameters or WorldParameters(), seed))


@cache
def warm() -> None:
    """Have everything compiled that a simulated bench needs, or load what was.

    Later it would hold up a world that is watched: after an update it takes half a minute.
    """
    rig = open_virtual()
    rig.advance(WARM_US)
    rig.close()


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
        self._stretch = self._new_stretch()
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

    def _new_stretch(self) -> Stretch:
        """Compiled time for this boot of the drum board."""
        return Stretch(self._bench, self._drum.controller, self._drum.registers)

    def _go_on(self, until_us: int) -> bool:
        """Up to the next event; False where there is none until then and the time has come."""
        return (self._pass_quietly if self._stretch.possible else self._pass_event)(until_us)

    def _pass_quietly(self, until_us: int) -> bool:
        """As :meth:`_pass_event` with all load-cell conversions on the way compiled."""
        drum_us, taxels_us = self._drum.next_but_silence_us, self._taxels.next_us
        event_us = min(drum_us, taxels_us)
        at_us = max(self.time_us, int(min(event_us, until_us)))
        if self._bench.loadcell.next_us <= at_us:
            news = self._pass(at_us)
            if news != DONE:
                return True if news & (STOPPED | TOUCHED | SETTLED_NOW) else self._pass_event(at_us)
        elif at_us // 1000 > self._bench.plant.time_ms and self._mechanics(at_us // 1000):
            return True
        self.time_us = self._drum.now_us = at_us
        if at_us >= drum_us:
            self._drum.pass_time(at_us)
        if at_us >= taxels_us:
            self._taxels.pass_time(at_us)
        return event_us <= at_us

    def _pass(self, until_us: int) -> int:
        """Run compiled through load-cell conversions and nothing else; why it ended."""
        marks, cell = self._bench.plant.index_rises, self._drum.controller.cell
        taken = cell.sequence
        news = self._stretch.run(until_us)
        if cell.sequence > taken:
            self.time_us = self._drum.now_us = self._drum.controller.now_us
        if news == STOPPED:
            self._stopped(marks)
        return news

    def _pass_event(self, until_us: int) -> bool:
        """As :meth:`_go_on`, and a load-cell conversion is an event of its own."""
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
            self._stretch = self._new_stretch()
        else:
            self._taxels.reset(self.time_us)
