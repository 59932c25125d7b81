"""The drum's chip in a closed loop with the simulated mechanics, and trials on it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.bench.chips.simavr import Input, Output
from rigctl.bench.electrics import LIFT, PRESS, actuator_pins
from rigctl.bench.mechanics import DrumTrajectory
from rigctl.bench.parameters import WorldParameters, validated
from rigctl.boards.drum_codes import Command
from rigctl.boards.drum_states import Fault, State
from tests.firmware.drum.support.bare_bench import BareBench
from tests.firmware.drum.support.chip import MS, DrumChip

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
        self.bench = BareBench(self.parameters, plate, seed)
        self.plant = self.bench.plant
        super().__init__(image)

    def _wire_up(self) -> None:
        p = self.parameters
        self._levels = {Input.ESTOP: False, Input.END_UP: False, Input.END_DOWN: False}
        self.connect()
        self.chip.place_drum(round(p.start_mm / p.mm_per_step))
        self._start_steps = float(self.x.drum_place)

    def connect(self) -> None:
        """Pass changed disturbances of the bench to its parts and to the chip's pins."""
        bench, x = self.bench, self.x
        circuit = bench.disturbances.circuit
        bench.wire_drum(x)
        bench.apply_disturbances()
        x.loadcell_period_q16 = round(bench.loadcell.period_us * CYCLES_PER_US * 65536)
        x.loadcell_clock_open, x.loadcell_data_open = not circuit.cell_clock, not circuit.cell_data
        x.supply_mv = circuit.logic_mv
        self._set_level(Input.ESTOP, bench.disturbances.estop_level())

    def _set_level(self, signal: Input, level: bool) -> None:
        if level != self._levels[signal]:
            self._levels[signal] = level
            self.pin(signal, int(level))

    def _advance_bench(self, duty: float) -> None:
        end_ms = int(self.x.cycle) // MS
        drum_mm = (self.x.drum_place - self._start_steps) * self.parameters.mm_per_step
        voltage = duty * float(self.bench.electrics[PRESS if duty > 0.0 else LIFT])
        self.plant.advance(end_ms, voltage, DrumTrajectory(end_ms * 1000.0, drum_mm, 0.0))
        self.rod_mm, self.force_g = self.plant.rod_mm, self.plant.force_g
        self.forces.append(self.force_g)
        if self.x.loadcell_ready <= (end_ms + 1) * MS:
            self.x.loadcell_counts = self.bench.loadcell.weigh(end_ms * 1000)
        travel_mm = self.parameters.actuator_travel_mm
        share, up, down = actuator_pins(self.bench.electrics, self.rod_mm, travel_mm, end_ms)
        self.chip.analog[0, 0] = share
        self._set_level(Input.END_UP, up)
        self._set_level(Input.END_DOWN, down)

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
        assert self.state is State.HOLD, Fault(self.get("fault")).name
        self.poll_for(REST_MS)
        rest = len(self.forces)
        assert self.command(Command.RUN, 20_000) == 0
        assert self.state is State.HOLD, Fault(self.get("fault")).name
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
