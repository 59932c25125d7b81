"""The simulated bench: mechanics, skin, load cell and ground truth, for both kinds of boards."""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import Executor
from functools import lru_cache
from typing import Any

import numpy as np

from rigctl.bench import electrics
from rigctl.bench.circuit import TestPoints, Wire, wire_on
from rigctl.bench.contact import (
    ForceTable,
    Mounting,
    contact_tables,
    draw_mounting,
    force_table,
)
from rigctl.bench.ground_truth import GroundTruth
from rigctl.bench.load_cell import LoadCellAmplifier
from rigctl.bench.mechanics import DrumTrajectory, Mechanics
from rigctl.bench.parameters import WorldParameters, validated
from rigctl.bench.simulated_rig import Disturbances
from rigctl.bench.skin import Skin
from rigctl.boards.drum_codes import Signal
from rigctl.config.rig_config import PAPER_ARRAY, TaxelArray

LOG_EVERY_MS = 1000


@lru_cache(maxsize=4)
def _mounted(
    name: str, parameters: WorldParameters, seed: int, number: int, sensor: TaxelArray
) -> tuple[Mounting, ForceTable]:
    """Return the alignment of a mounting of a session, and its contact force.

    Kept, as most rigs are opened anew with the same world and seed, and start with the same plate.
    """
    mounting = draw_mounting(parameters, seed, number, sensor.count)
    tables = contact_tables(name, parameters, sensor.shape)
    return mounting, force_table(tables, parameters, mounting)


class Bench:
    """One simulated bench, reproducible for a seed. The boards advance its time.

    ``executor``, if given, computes noise in advance. ``on_sync(level, at_us)``, if set, receives
    the edges of the sync line. ``has_network``: the taxel board computes the voltages at its inputs
    itself, as a simulated chip does. ``sensor``: what lies under the drum.
    ``electrics``: constants of the electrical layer.

    Raises WrongUse for a parameter outside its plausible range.
    """

    def __init__(
        self,
        parameters: WorldParameters,
        seed: int,
        executor: Executor | None = None,
        has_network: bool = False,
        sensor: TaxelArray = PAPER_ARRAY,
    ) -> None:
        self.parameters = validated(parameters, sensor.count)
        self.sensor = sensor
        self.seed = seed
        self.disturbances = Disturbances()
        self.electrics = electrics.constants(self.disturbances.circuit)
        self._has_network = has_network
        self.plant = Mechanics(parameters)
        self.skin = Skin(parameters, seed, self.plant, executor, sensor)
        self.loadcell = LoadCellAmplifier(parameters, seed, self.plant, self.disturbances)
        self._truth = GroundTruth()
        self.logged_ms = 0
        self._logged_level = 0
        self._mountings = 0
        self.sync_level = self._sync_pin = 0
        self._has_sync = True
        self.on_sync: Callable[[int, int], None] | None = None
        self._sync_edges: list[tuple[int, int]] = []
        self.set_plate("A")

    @property
    def truth(self) -> GroundTruth:
        """Ground truth up to the present time."""
        self.log_truth()
        return self._truth

    def set_plate(self, name: str) -> None:
        """Mount a plate, with an alignment of its own. Raises WrongUse for an unknown name."""
        tables = contact_tables(name, self.parameters, self.sensor.shape)
        mounting, forces = _mounted(name, self.parameters, self.seed, self._mountings, self.sensor)
        self._mountings += 1
        self.plate = name
        self.skin.set_plate(tables, mounting)
        self.plant.set_force_table(forces)

    def skip_mountings(self, count: int) -> None:
        """Leave out the alignments of this many mountings, which were those of another sitting."""
        self._mountings += count

    def apply_disturbances(self) -> None:
        """Pass changed disturbances to the electrical layer, the mechanics and the sensor."""
        now, circuit = self.disturbances, self.disturbances.circuit
        self.electrics[:] = electrics.constants(
            circuit, now.absent, now.inverted, now.has_supply, now.held_ends
        )
        self.skin.touch = now.touch
        self.skin.connect(electrics.taxel_map(circuit, self._has_network, self.sensor))
        self.loadcell.connect(circuit)
        self.plant.set_disturbances(now.motor_jammed, now.push_g)
        self.plant.set_diameter(circuit.diameter)
        if circuit.sync != self._has_sync:
            self._has_sync = circuit.sync
            self.set_sync(self._sync_pin, self.plant.time_ms * 1000)

    def wire_drum(self, io: Any) -> None:
        """Set a drum board's inputs of motor and index mark, which both kinds of boards have."""
        p, now = self.parameters, self.disturbances
        index, circuit = now.index_wire(), now.circuit
        has_edges = index in (Wire.DRAWN, Wire.INVERTED)
        io.motor_jammed = int(not now.motor_turns)
        io.direction, io.step_size = int(circuit.direction), circuit.step_size
        io.steps_per_turn = round(p.steps_per_turn) // circuit.marks_per_turn
        io.mark_length_steps = has_edges * round(p.index_length_mm / p.mm_per_step)
        io.mark_inverted = int(index in (Wire.INVERTED, Wire.OPEN))

    def test_points(self, io: Any) -> TestPoints:
        """Return what a meter shows on the bench; ``io``: outputs of the drum board."""
        now, circuit = self.disturbances, self.disturbances.circuit
        return TestPoints(
            boards_v=circuit.logic_mv * 1e-3,
            motor_supply=circuit.motor_supply * now.has_supply,
            actuator_supply=circuit.actuator_supply * now.has_supply,
            bridge_enabled=circuit.bridge_held_on or bool(io.bridge_on),
            driver_enabled=wire_on(circuit.enable, bool(io.stepper_on)),
        )

    def index_at_taxels(self, level: int) -> int | None:
        """Return the level of the index wire at the taxel board, None without that wire."""
        circuit = self.disturbances.circuit
        return level ^ (circuit.index is Wire.INVERTED) if circuit.index_at_uno else None

    def set_sync(self, level: int, at_us: int) -> None:
        """Handle a new level of the drum board's sync pin; a resistor holds an open wire low."""
        self._sync_pin = level
        if Signal.SYNC in self.disturbances.absent:
            return
        level = level ^ (Signal.SYNC in self.disturbances.inverted)
        level = level if self._has_sync else 0
        if level == self.sync_level:
            return
        self.sync_level = level
        self._sync_edges.append((at_us, level))
        if self.on_sync is not None:
            self.on_sync(level, at_us)

    def advance(self, until_ms: int, drive: float, trajectory: DrumTrajectory) -> None:
        """Advance the mechanics, at most 1 s a call; skin and ground truth follow when logged.

        ``drive``: duty of the drum board's bridge pins, positive presses.
        """
        if until_ms - self.logged_ms > LOG_EVERY_MS:
            self.log_truth()
        voltage = drive * float(self.electrics[electrics.PRESS if drive > 0.0 else electrics.LIFT])
        self.plant.advance(until_ms, voltage, trajectory)

    def log_truth(self) -> None:
        """Append what the plant did since the last call to the ground truth."""
        self.skin.advance()
        first_ms, n_rows = self.logged_ms, self.plant.time_ms - self.logged_ms
        if not n_rows:
            return
        sync = np.full(n_rows, self._logged_level, np.uint8)
        for at_us, level in self._sync_edges:
            sync[max(0, math.ceil(at_us / 1000) - first_ms - 1) :] = level
        self._logged_level = self.sync_level
        self._sync_edges.clear()
        self._truth.append(*self.plant.motion_since(first_ms), sync)
        self.logged_ms = self.plant.time_ms
