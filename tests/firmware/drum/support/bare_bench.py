"""The simulated bench of a drum board alone: no skin, no ground truth."""

from __future__ import annotations

from functools import lru_cache

from rigctl.bench.bench import Bench
from rigctl.bench.contact import ForceTable, contact_tables, draw_mounting, force_table
from rigctl.bench.electrics import constants
from rigctl.bench.load_cell import LoadCellAmplifier
from rigctl.bench.mechanics import Mechanics
from rigctl.bench.parameters import WorldParameters
from rigctl.bench.simulated_rig import Disturbances


@lru_cache(maxsize=4)
def mounted_contact(plate: str, parameters: WorldParameters, seed: int) -> ForceTable:
    """Return the contact of a bench's first mounting of a plate."""
    seat = draw_mounting(parameters, seed, 0)
    return force_table(contact_tables(plate, parameters), parameters, seat)


class BareBench:
    """Mechanics, load cell and wires for the boards of the tests, virtual or chips."""

    def __init__(self, parameters: WorldParameters, plate: str, seed: int) -> None:
        self.parameters = parameters
        self.disturbances = Disturbances()
        self.electrics = constants(self.disturbances.circuit)
        self.plant = Mechanics(parameters)
        self.plant.set_force_table(mounted_contact(plate, parameters, seed))
        self.loadcell = LoadCellAmplifier(parameters, seed, self.plant, self.disturbances)
        self.logged_ms = 0

    def log_truth(self) -> None:
        """Discard the log."""
        self.logged_ms = self.plant.time_ms

    def set_sync(self, level: int, at_us: int) -> None:
        """Ignore the sync line, which is not connected."""

    def index_at_taxels(self, level: int) -> int | None:
        """Return the index wire's level at the taxel board, which is not there."""
        return None

    wire_drum = Bench.wire_drum

    def apply_disturbances(self) -> None:
        """Pass emergency stop, wiring and a push, the only disturbances that are used."""
        now = self.disturbances
        self.electrics[:] = constants(now.circuit, has_supply=now.has_supply)
        self.loadcell.connect(now.circuit)
        self.plant.set_disturbances(now.motor_jammed, now.push_g)
        self.plant.set_diameter(now.circuit.diameter)
