"""The drum's chip in a closed loop with the simulated mechanics, and trials on it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from rigctl.simulation.bench.contact import ForceTable, contact_tables, draw_mounting, force_table
from rigctl.simulation.bench.electrics import actuator_pins
from rigctl.simulation.bench.load_cell import LoadCellAmplifier
from rigctl.simulation.bench.mechanics import DrumTrajectory, Mechanics
from rigctl.simulation.bench.world.parameters import WorldParameters, validated
from rigctl.simulation.chips.simavr import Output
from rigctl.simulation.simulated_rig import Disturbances
from rigctl.wire.drum.codes import Command
from rigctl.wire.drum.states import State
from tests.firmware.drum.support.chip import MS, WIRED, DrumChip

CYCLES_PER_US = 16
MEAN_MS = 200
"""Span of the mean that decides whether the force has settled."""
BAND = 0.02
REST_MS = 300
"""Pause between HOLD and RUN."""
PLATE_START_MM = 10.0
"""Distance from the index mark to the start of a trial."""


@dataclass(frozen=True)
class Trial:
    """True force of one trial at a set speed and force; shares are of the set force."""

    settle_s: float
    """Time from first touch until the 200 ms mean stays within ±2 %; inf if it never does."""
    overshoot: float
    """Highest millisecond from touch to the start of the run, while the drum is still."""
    approach_mean: float
    """Highest 200 ms mean in that time."""
    mean_error: float
    window: NDArray[np.float64]


@lru_cache(maxsize=4)
def mounted_contact(plate: str, parameters: WorldParameters, seed: int) -> ForceTable:
    """Return the contact of a bench's first mounting of a plate."""
    seat = draw_mounting(parameters, seed, 0)
    return force_table(contact_tables(plate, parameters), parameters, seat)


class PlantDrum(DrumChip):
    """The image on its chip with the simulated actuator, contact and load cell."""

    def __init__(
        self,
        parameters: WorldParameters | None = None,
        plate: str = "A",
        seed: int = 1,
        image: str = "firmware/drum.elf",
        begin_mm: float = PLATE_START_MM,
    ) -> None:
        self._begin_mm = begin_mm
        self.parameters = validated(parameters or WorldParameters())
        self.plant = Mechanics(self.parameters)
        self.plant.set_force_table(mounted_contact(plate, self.parameters, seed))
        self._cell = LoadCellAmplifier(self.parameters, seed, self.plant, Disturbances())
        super().__init__(image)

    def _wire_up(self) -> None:
        p, x = self.parameters, self.x
        x.loadcell_period_q16 = round(self._cell.period_us * CYCLES_PER_US * 65536)
        x.steps_per_turn = round(p.steps_per_turn)
        x.mark_length_steps = round(p.index_length_mm / p.mm_per_step)
        self.chip.place_drum(round(p.start_mm / p.mm_per_step))
        self._start_steps = float(x.drum_place)

    def _advance_bench(self, duty: float) -> None:
        end_ms = int(self.x.cycle) // MS
        drum_mm = (self.x.drum_place - self._start_steps) * self.parameters.mm_per_step
        self.plant.advance(end_ms, duty, DrumTrajectory(end_ms * 1000.0, drum_mm, 0.0))
        self.rod_mm, self.force_g = self.plant.rod_mm, self.plant.force_g
        self.forces.append(self.force_g)
        if self.x.loadcell_ready <= (end_ms + 1) * MS:
            self.x.loadcell_counts = self._cell.weigh(end_ms * 1000)
        travel_mm = self.parameters.actuator_travel_mm
        self.chip.analog[0, 0] = actuator_pins(WIRED, self.rod_mm, travel_mm)[0]

    def prepare(self) -> None:
        """Arm, home and tare."""
        self.arm()
        assert self.command(Command.HOME, 20_000) == 0
        assert self.command(Command.TARE, 8000) == 0

    def trial(self, speed_mm_s: float, force_g: float) -> Trial:
        """Place the drum, approach, run once and lift. Raises AssertionError on any fault."""
        self.set("speed_set", round(100 * speed_mm_s))
        self.set("force_set", round(10 * force_g))
        self._place()
        begun = len(self.forces)
        self.clear_edges()
        assert self.command(Command.APPROACH, 15_000) == 0
        assert self.state is State.HOLD, self.get("fault")
        self.poll_for(REST_MS)
        rest = len(self.forces)
        assert self.command(Command.RUN, 20_000) == 0
        assert self.state is State.HOLD, self.get("fault")
        trial = evaluate_trial(
            np.array(self.forces[begun:]), rest - begun, self._window(begun), force_g
        )
        assert self.command(Command.RETRACT, 5000) == 0
        return trial

    def _place(self) -> None:
        turn = self.get("steps_per_turn")
        ahead = round(self._begin_mm / self.parameters.mm_per_step)
        steps = self.get("steps")
        self.set("move_target", -(-(steps - ahead) // turn) * turn + ahead)
        assert self.command(Command.MOVE, 20_000) == 0

    def _window(self, begun: int) -> slice:
        rise, fall = (int(cycle) // MS for cycle in self.edges(Output.SYNC)[:, 0])
        offset = int(self.x.cycle) // MS - len(self.forces) + begun
        return slice(rise - offset, fall - offset)


def evaluate_trial(forces: NDArray[np.float64], rest: int, window: slice, force_g: float) -> Trial:
    """Return the figures of the true force of each ms, (n,); the drum turns from ``rest`` on."""
    touch = int(np.argmax(forces > 0))
    means = np.convolve(forces[touch:], np.ones(MEAN_MS) / MEAN_MS, "valid") / force_g - 1
    approach = means[: rest - touch - MEAN_MS]
    outside = np.flatnonzero(np.abs(approach) > BAND)
    last = int(outside[-1]) + 1 if outside.size else 0
    return Trial(
        settle_s=(last + MEAN_MS) / 1000 if last < approach.size else float("inf"),
        overshoot=float(forces[touch:rest].max() / force_g - 1),
        approach_mean=float(approach.max()) if approach.size else 0.0,
        mean_error=float(forces[window].mean() / force_g - 1),
        window=forces[window],
    )
