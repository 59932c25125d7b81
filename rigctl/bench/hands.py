"""The hands and eyes of a person at a simulated bench: they do what a setup asks, and tell."""

from __future__ import annotations

from collections.abc import Callable

from rigctl.bench.bench import Bench
from rigctl.bench.circuit import TestPoints
from rigctl.bench.simulated_rig import FaultInjection
from rigctl.boards.drum_codes import Signal

FINGER_G = 300.0
MASSES_G = (200.0, 500.0)
CAPACITY_G = 5000.0
COUNTS_PER_SENSITIVITY = 256 * 2**23
"""An HX711 at gain 128 counts at capacity the cell's sensitivity times this."""
CLEAR_MM = 8.0
SEEN_MM = 0.05
"""A movement of the actuator that a finger on it feels."""
MOTOR_STEPS, BELT = 200, 4


class SimulatedHands:
    """One person at one bench. A question that they do not know they answer with ``done``.

    ``meter()`` returns what they would measure now.
    """

    def __init__(
        self, bench: Bench, faults: FaultInjection, meter: Callable[[], TestPoints]
    ) -> None:
        self._bench = bench
        self._rod_mm = self._drum_mm = 0.0
        self._acts: dict[str, Callable[[float], object]] = {
            "press_estop": lambda _: faults.press_estop(),
            "release_estop": lambda _: faults.release_estop(),
            "hold_upper": lambda _: faults.hold_ends(upper=True),
            "hold_lower": lambda _: faults.hold_ends(lower=True),
            "free_ends": lambda _: faults.hold_ends(),
            "free_cell": lambda _: faults.push(0.0),
            "press_cell": lambda _: faults.push(FINGER_G),
            "release_cell": lambda _: faults.push(0.0),
            "lay_mass": faults.push,
            "make_room": self._make_room,
            "watch_rod": self._watch_rod,
            "mark_drum": self._mark_drum,
        }
        p = bench.parameters
        self._answers: dict[str, Callable[[], str]] = {
            "circumference": lambda: f"{self._turn_mm():g}",
            "microsteps": lambda: f"{p.steps_per_turn / (MOTOR_STEPS * BELT):g}",
            "capacity": lambda: f"{CAPACITY_G:g}",
            "sensitivity": self._sensitivity,
            "mass_first": lambda: f"{MASSES_G[0]:g}",
            "mass_second": lambda: f"{MASSES_G[1]:g}",
            "is_supply_cut": lambda: _yes(not any(meter()[1:3])),
            "is_bridge_off": lambda: _yes(not meter().bridge_enabled),
            "make_room": lambda: "clear",
            "which_way_rod": self._which_way_rod,
            "count_turns": lambda: f"{self._turns():.2f}",
            "which_way_drum": lambda: f"{'with' if self._moved_mm() > 0 else 'against'} the arrow",
            "mount_plate": lambda: "yes",
            **{f"fitted_{signal.name.lower()}": self._has(signal) for signal in Signal},
        }

    def answer(self, key: str, amount: float) -> str:
        """Do what a question asks, with its ``amount``, and return the answer."""
        act = self._acts.get(key)
        if act is not None:
            act(amount)
        known = self._answers.get(key)
        return known() if known is not None else "done"

    def _has(self, signal: Signal) -> Callable[[], str]:
        return lambda: _yes(signal not in self._bench.disturbances.absent)

    def _sensitivity(self) -> str:
        ug_per_count = self._bench.parameters.loadcell_ug_per_count
        return f"{CAPACITY_G * 1e9 / (ug_per_count * COUNTS_PER_SENSITIVITY):.3f}"

    def _make_room(self, _: float) -> None:
        highest_mm = self._bench.parameters.contact_mm - CLEAR_MM
        if self._bench.plant.rod_mm > highest_mm:
            self._bench.plant.set_rod(highest_mm)

    def _watch_rod(self, _: float) -> None:
        self._rod_mm = self._bench.plant.rod_mm

    def _which_way_rod(self) -> str:
        moved_mm = self._bench.plant.rod_mm - self._rod_mm
        if abs(moved_mm) < SEEN_MM:
            return "not at all"
        return "down" if moved_mm > 0 else "up"

    def _mark_drum(self, _: float) -> None:
        self._drum_mm = self._bench.plant.drum_mm

    def _moved_mm(self) -> float:
        return self._bench.plant.drum_mm - self._drum_mm

    def _turns(self) -> float:
        return abs(self._moved_mm()) / self._turn_mm()

    def _turn_mm(self) -> float:
        """Return what a strip of paper around the drum measures."""
        circuit = self._bench.disturbances.circuit
        return self._bench.parameters.circumference_mm * circuit.diameter


def _yes(is_so: bool) -> str:
    return "yes" if is_so else "no"
