"""The attacked bench: simulated mechanics with a virtual board or a simulated chip.

Both have the same plate, contact and actuator. The judge reads the mechanics' own log; the board's
registers are only for the attacker.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from rigctl.bench.boards.drum_cosimulation import DrumCosimulation
from rigctl.bench.circuit import Circuit
from rigctl.bench.mechanics import ACTUATOR_SPEED, DRUM_MM, FORCE_G, RING_MS, Mechanics
from rigctl.bench.parameters import WorldParameters, validated
from rigctl.boards.drum_registers import BY_NAME
from rigctl.boards.drum_states import State
from tests.firmware.drum.support.bare_bench import BareBench, mounted_contact
from tests.firmware.drum.support.overshoot import overshoot_g

PLATE = "A"
NEAR = validated(WorldParameters(contact_mm=10.0, actuator_start_mm=0.0))
"""Shortest plausible distance to the contact, for a short approach."""
STIFF = validated(replace(NEAR, stiffness_g_mm=900.0, frame_share=0.5, pressure_power=2.1))
"""The same on the stiffest plausible contact, for attacks on wires."""
BALANCED = validated(replace(STIFF, loadcell_offset_counts=3000.0))
"""The same with a bridge that reads about 0 under its drum: as it does when it is broken."""
CLOSE = validated(replace(STIFF, actuator_start_mm=9.9))
"""The stiffest contact a hair below the drum."""
SEED = 1
ALIKE_G = 30.0
"""A broken cell that reads within it of the lifted drum shows nothing (decision 0040)."""
SLOW_MM_S = 2.0
MOST_G, OVERRUN_UM = (BY_NAME[name].address for name in ("most_force", "overrun_um"))


class Span(NamedTuple):
    """The bench's log between two times, ms.

    ``force_g`` and ``place_mm``: float64 (ms,), at the end of each millisecond, ``place_mm`` also
    at the start; ``rod_mm``: at start and end; ``drive``: lowest and highest duty, at least of the
    last millisecond.
    """

    start_ms: int
    end_ms: int
    force_g: NDArray[np.float64]
    place_mm: NDArray[np.float64]
    rod_mm: tuple[float, float]
    drive: tuple[float, float]


class AttackBench(Protocol):
    """A bench as the attacker uses it."""

    parameters: WorldParameters

    @property
    def plant(self) -> Mechanics:
        """The mechanics."""

    @property
    def state(self) -> State:
        """State that the board reports."""

    @property
    def last_heartbeat_ms(self) -> int:
        """Simulated time of the last heartbeat."""

    def set_heartbeat(self, on: bool) -> None:
        """Switch the heartbeat on or off."""

    def run(self, milliseconds: int) -> None:
        """Advance, less if the board's state changes."""

    def drive(self) -> tuple[float, float]:
        """Return the lowest and highest duty since the last call."""

    def write(self, address: int, words: tuple[int, ...]) -> int:
        """Write registers; return 0 if the board accepts them."""

    def read(self, address: int, count: int) -> list[int]:
        """Read registers."""

    def estop(self, pressed: bool) -> None:
        """Press or release the emergency stop."""

    def connect(self, circuit: Circuit) -> None:
        """Connect the bench in this way."""

    def push(self, force_g: float) -> None:
        """Press on the load cell by hand."""

    def reset(self) -> None:
        """Press the board's reset button."""

    def close(self) -> None:
        """Free the board."""


class Log:
    """Reads the mechanics' log in consecutive spans."""

    def __init__(self, bench: AttackBench) -> None:
        self._bench = bench
        self._read_until_ms, self._rod_mm = bench.plant.time_ms, bench.plant.rod_mm

    def span(self) -> Span:
        """Return the log since the last call."""
        plant, start_ms, rod_mm = self._bench.plant, self._read_until_ms, self._rod_mm
        self._read_until_ms, self._rod_mm = plant.time_ms, plant.rod_mm
        rows = np.arange(start_ms, self._read_until_ms + 1) % RING_MS
        force_g, place_mm = plant.log[rows[1:], FORCE_G], plant.log[rows, DRUM_MM]
        rods = (rod_mm, self._rod_mm)
        return Span(start_ms, self._read_until_ms, force_g, place_mm, rods, self._bench.drive())


def is_balanced(parameters: WorldParameters) -> bool:
    """Return whether the load cell under the lifted drum reads about as a broken one."""
    offset_g = parameters.loadcell_offset_counts * parameters.loadcell_ug_per_count * 1e-6
    return abs(offset_g) < ALIKE_G


def slow_actuator(plant: Mechanics) -> None:
    """Make the actuator slow, like a worn or cold one."""
    plant.constants[ACTUATOR_SPEED] = SLOW_MM_S


def limit_g(bench: AttackBench, most_g: float | None = None, further_um: float = 0.0) -> float:
    """Return the highest true force on this bench, where the board lifts at ``most_g``.

    By default that is the limit of any write. ``further_um``: further travel before it lifts.
    """
    most_g = bench.read(MOST_G, 1)[0] if most_g is None else most_g
    return _limit_g(bench.parameters, most_g, bench.read(OVERRUN_UM, 1)[0] + further_um)


@cache
def _limit_g(parameters: WorldParameters, most_g: float, overrun_um: float) -> float:
    return most_g + overshoot_g(overrun_um, most_g, mounted_contact(PLATE, parameters, SEED))


class VirtualBench:
    """A virtual board at power-up with direct access to its registers."""

    def __init__(self, library: Path | None = None, parameters: WorldParameters = NEAR) -> None:
        self.parameters = parameters
        self._mechanics = BareBench(parameters, PLATE, SEED)
        self._drum = DrumCosimulation(self._mechanics, library)
        self._board = self._drum.firmware
        self._silent_since_ms = 0
        self.set_heartbeat(True)

    @property
    def plant(self) -> Mechanics:
        """The mechanics."""
        return self._mechanics.plant

    @property
    def state(self) -> State:
        """State that the board reports."""
        return State(self._board.io.state)

    @property
    def last_heartbeat_ms(self) -> int:
        """Simulated time of the last heartbeat."""
        return self.plant.time_ms if self._board.io.heartbeat_on else self._silent_since_ms

    def set_heartbeat(self, on: bool) -> None:
        """Switch the heartbeat on or off."""
        self._silent_since_ms = self.last_heartbeat_ms
        self._board.io.heartbeat_on = on

    def run(self, milliseconds: int) -> None:
        """Advance, less if state, fault or result changes."""
        self._drum.run(self.plant.time_ms + milliseconds, stop_on_change=True)

    def drive(self) -> tuple[float, float]:
        """Return the duty of the last millisecond, twice."""
        duty = self._board.io.drive
        return duty, duty

    def write(self, address: int, words: tuple[int, ...]) -> int:
        """Write registers; return 0 if the board accepts them."""
        return self._board.write(address, words)

    def read(self, address: int, count: int) -> list[int]:
        """Read registers."""
        return self._board.read(address, count)

    def estop(self, pressed: bool) -> None:
        """Press or release the emergency stop."""
        self._mechanics.disturbances.estop_pressed = pressed
        self._drum.apply_disturbances()

    def connect(self, circuit: Circuit) -> None:
        """Connect the bench in this way."""
        self._mechanics.disturbances.circuit = circuit
        self._drum.apply_disturbances()

    def push(self, force_g: float) -> None:
        """Press on the load cell by hand."""
        self._mechanics.disturbances.push_g = force_g
        self._drum.apply_disturbances()

    def reset(self) -> None:
        """Press the board's reset button."""
        self._drum.reset()

    def close(self) -> None:
        """Free the board."""
        self._board.close()
