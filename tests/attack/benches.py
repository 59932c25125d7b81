"""The bench that is attacked: the world's mechanics under a virtual board or under a chip.

Both have the same plate, contact and actuator. What is handed to the judge comes from the
mechanics' own log; what the board says of itself is for the attacker.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from rigctl.simulation.bench.load_cell import LoadCellAmplifier
from rigctl.simulation.bench.mechanics import ACTUATOR_SPEED, DRUM_MM, FORCE_G, RING_MS, Mechanics
from rigctl.simulation.bench.parameters import WorldParameters, validated
from rigctl.simulation.boards.drum_cosimulation import DrumCosimulation
from rigctl.simulation.simulated_rig import Disturbances
from rigctl.wire.drum.register_table import BY_NAME
from rigctl.wire.drum.states import State
from tests.firmware.drum.support.overshoot import overshoot_g
from tests.firmware.drum.support.plant_drum import pressed

PLATE = "A"
NEAR = validated(WorldParameters(contact_mm=10.0, actuator_start_mm=0.0))
"""Contact as near as benches have it: an approach is short."""
SEED = 1
WEAK_MM_S = 2.0
MOST_G, OVERRUN_UM = (BY_NAME[name].address for name in ("most_force", "overrun_um"))


class Span(NamedTuple):
    """What the bench logged from one time to another, ms.

    ``force_g`` and ``place_mm``: float64 (ms,), at the end of each millisecond, the place also at
    the beginning; ``rod_mm``: at beginning and end; ``drive``: lowest and highest duty seen, of the
    last millisecond at least.
    """

    start_ms: int
    end_ms: int
    force_g: NDArray[np.float64]
    place_mm: NDArray[np.float64]
    rod_mm: tuple[float, float]
    drive: tuple[float, float]


class AttackBench(Protocol):
    """What an attacker can do with a bench, and what it logs."""

    @property
    def plant(self) -> Mechanics:
        """The mechanics."""

    @property
    def state(self) -> State:
        """State that the board says."""

    @property
    def beat_ms(self) -> int:
        """World time of the last heartbeat that the bench's own computer sent."""

    def beats(self, on: bool) -> None:
        """Let the heartbeat go on, or fall silent."""

    def run(self, milliseconds: int) -> None:
        """Let time pass, or less of it where the board's state changes."""

    def drive(self) -> tuple[float, float]:
        """Lowest and highest duty since the last call."""

    def write(self, address: int, words: tuple[int, ...]) -> int:
        """Write registers; 0 where the board took them."""

    def read(self, address: int, count: int) -> list[int]:
        """Read registers."""

    def estop(self, pressed: bool) -> None:
        """Press or release the emergency stop."""

    def reset(self) -> None:
        """Press the board's reset button."""

    def close(self) -> None:
        """Free the board."""


class Log:
    """Reads the mechanics' log span by span, so that no millisecond is left out."""

    def __init__(self, bench: AttackBench) -> None:
        self._bench = bench
        self._told_ms, self._rod_mm = bench.plant.time_ms, bench.plant.rod_mm

    def span(self) -> Span:
        """What was logged since the last call."""
        plant, start_ms, rod_mm = self._bench.plant, self._told_ms, self._rod_mm
        self._told_ms, self._rod_mm = plant.time_ms, plant.rod_mm
        rows = np.arange(start_ms, self._told_ms + 1) % RING_MS
        force_g, place_mm = plant.log[rows[1:], FORCE_G], plant.log[rows, DRUM_MM]
        rods = (rod_mm, self._rod_mm)
        return Span(start_ms, self._told_ms, force_g, place_mm, rods, self._bench.drive())


def weaken(plant: Mechanics) -> None:
    """Make the actuator slow, as a worn or cold one is."""
    plant.constants[ACTUATOR_SPEED] = WEAK_MM_S


def limit_g(bench: AttackBench) -> float:
    """True force that may come about on this bench, whatever is written."""
    return _limit_g(bench.read(MOST_G, 1)[0], bench.read(OVERRUN_UM, 1)[0])


@cache
def _limit_g(most_g: int, overrun_um: int) -> float:
    return most_g + overshoot_g(overrun_um, most_g, pressed(PLATE, NEAR, SEED))


class _Mechanics:
    """A bench without its skin: nobody looks at the taxels."""

    def __init__(self) -> None:
        self.parameters = NEAR
        self.disturbances = Disturbances()
        self.plant = Mechanics(NEAR)
        self.plant.set_force_table(pressed(PLATE, NEAR, SEED))
        self.loadcell = LoadCellAmplifier(NEAR, SEED, self.plant, self.disturbances)
        self.logged_ms = 0

    def log_truth(self) -> None:
        """Forget what is behind: attacks are judged span by span."""
        self.logged_ms = self.plant.time_ms

    def set_sync(self, level: int, at_us: int) -> None:
        """Ignore the sync line, which is not connected."""

    def apply_disturbances(self) -> None:
        """Pass no disturbance: only the emergency stop is ever used."""
        self.plant.set_disturbances(False, 0.0)


class VirtualBench:
    """A virtual board at power-up, stepped in world time; its registers are at hand."""

    def __init__(self, library: Path | None = None) -> None:
        self._mechanics = _Mechanics()
        self._drum = DrumCosimulation(self._mechanics, library)
        self._board = self._drum.firmware
        self._silent_since_ms = 0
        self.beats(True)

    @property
    def plant(self) -> Mechanics:
        """The mechanics."""
        return self._mechanics.plant

    @property
    def state(self) -> State:
        """State that the board says."""
        return State(self._board.io.state)

    @property
    def beat_ms(self) -> int:
        """World time of its own computer's last heartbeat."""
        return self.plant.time_ms if self._board.io.heartbeat_on else self._silent_since_ms

    def beats(self, on: bool) -> None:
        """Let the heartbeat go on, or fall silent."""
        self._silent_since_ms = self.beat_ms
        self._board.io.heartbeat_on = on

    def run(self, milliseconds: int) -> None:
        """Let time pass, or less of it where state, fault or result change."""
        self._drum.run(self.plant.time_ms + milliseconds, stop_on_change=True)

    def drive(self) -> tuple[float, float]:
        """Duty of the last millisecond, twice."""
        duty = self._board.io.drive
        return duty, duty

    def write(self, address: int, words: tuple[int, ...]) -> int:
        """Write registers; 0 where the board took them."""
        return self._board.write(address, words)

    def read(self, address: int, count: int) -> list[int]:
        """Read registers."""
        return self._board.read(address, count)

    def estop(self, pressed: bool) -> None:
        """Press or release the emergency stop."""
        self._mechanics.disturbances.estop_pressed = pressed
        self._drum.apply_disturbances()

    def reset(self) -> None:
        """Press the board's reset button."""
        self._drum.reset()

    def close(self) -> None:
        """Free the board."""
        self._board.close()
