"""How the simulated bench is connected: supplies, drivers, sensors, boards and their wires.

The defaults of :class:`Circuit` are the drawing in ``arduino/README.md``;
``rigctl.bench.wirings`` lists the circuits that people build by mistake.
"""

from __future__ import annotations

from collections.abc import Set
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

from rigctl.boards.drum_codes import Signal

_N_LINES, _N_INPUTS = 3, 6
"""Of the drawing."""


class Wire(IntEnum):
    """State of a wire that a switch or sensor pulls low against a resistor to 5 V."""

    DRAWN = 0
    INVERTED = 1
    OPEN = 2
    LOW = 3


class Wiper(IntEnum):
    """What the input of the potentiometer is connected to."""

    DRAWN = 0
    OPEN = 1
    GROUND = 2
    SUPPLY = 3


class Direction(IntEnum):
    """What the driver makes of the direction line, with the numbers of ``enum sim_direction``."""

    DRAWN = 0
    REVERSED = 1
    STUCK = 2


@dataclass(frozen=True, slots=True)
class Circuit:
    """How the bench is connected; the defaults are the drawing.

    Supplies: ``logic_mv`` of the boards; ``actuator_supply`` and ``motor_supply`` as shares of the
    nominal voltage; ``stop_cuts_supply``: the second contact of the emergency stop interrupts both.

    Actuator: ``actuator_polarity`` is −1 with exchanged wires; ``press_half`` and ``lift_half`` of
    the bridge work; ``bridge_held_on``: its enable is high whatever the board says.

    Potentiometer: ``wiper``; ``is_position_reversed``; its ``ground_end`` and ``supply_end`` are
    connected; ``pull_down`` is fitted.

    Switches: ``estop``, ``upper_end``, ``lower_end``; ``ends_swapped``; ``switch_noise``: short
    spikes on all three wires.

    Load cell: of the signal a share ``cell_gain`` arrives, negative with exchanged wires, with
    ``cell_stray_counts`` and ``cell_noise_counts`` (rms) of other origin; a conversion takes
    ``cell_periods`` nominal periods; ``cell_clock`` and ``cell_data`` are connected; every
    ``cell_spike_every``-th conversion, if that is not 0, is wrong by 1,000 g.

    Stepper: ``coils`` are paired as drawn; ``step`` is connected; ``enable``; ``direction``; a
    pulse turns the drum by ``step_size`` steps; the surface moves by ``diameter`` times the nominal
    travel.

    Index and sync: ``index`` with ``marks_per_turn``; ``index_at_uno`` and ``sync`` are connected.

    Sensor: line *i* of the board leads to line ``lines[i]`` of the sensor, input *i* to
    ``inputs[i]``; ``open_lines``, ``open_inputs`` are broken, ``shorted_inputs`` are connected to
    each other, ``missing_dividers`` are inputs without one.

    Cables: ``ports`` are the boards that answer at the drum's and at the taxels' port.
    """

    logic_mv: int = 5000
    actuator_supply: float = 1.0
    motor_supply: float = 1.0
    stop_cuts_supply: bool = True
    actuator_polarity: float = 1.0
    press_half: bool = True
    lift_half: bool = True
    bridge_held_on: bool = False
    wiper: Wiper = Wiper.DRAWN
    is_position_reversed: bool = False
    ground_end: bool = True
    supply_end: bool = True
    pull_down: bool = True
    estop: Wire = Wire.DRAWN
    upper_end: Wire = Wire.DRAWN
    lower_end: Wire = Wire.DRAWN
    ends_swapped: bool = False
    switch_noise: bool = False
    cell_gain: float = 1.0
    cell_stray_counts: float = 0.0
    cell_noise_counts: float = 0.0
    cell_periods: float = 1.0
    cell_clock: bool = True
    cell_data: bool = True
    cell_spike_every: int = 0
    coils: bool = True
    step: bool = True
    enable: Wire = Wire.DRAWN
    direction: Direction = Direction.DRAWN
    step_size: float = 1.0
    diameter: float = 1.0
    index: Wire = Wire.DRAWN
    marks_per_turn: int = 1
    index_at_uno: bool = True
    sync: bool = True
    lines: tuple[int, ...] = tuple(range(_N_LINES))
    inputs: tuple[int, ...] = tuple(range(_N_INPUTS))
    open_lines: tuple[int, ...] = ()
    open_inputs: tuple[int, ...] = ()
    shorted_inputs: tuple[int, ...] = ()
    missing_dividers: tuple[int, ...] = ()
    ports: tuple[str, str] = ("drum", "taxels")

    @property
    def motor_turns(self) -> bool:
        """Whether the motor follows pulses while the board has switched its driver on."""
        return self.motor_supply > 0.0 and self.coils and self.step and self.enable is Wire.DRAWN


AS_DRAWN = Circuit()


class TestPoints(NamedTuple):
    """What a person finds with a meter: voltages of the boards, supplies as shares, enables."""

    boards_v: float
    motor_supply: float
    actuator_supply: float
    bridge_enabled: bool
    driver_enabled: bool


def wire_on(enable: Wire, is_on: bool) -> bool:
    """Return whether a driver is on behind its enable wire; a resistor holds off an open one."""
    return enable is not Wire.OPEN and is_on != (enable is Wire.INVERTED)


def wire_of(wire: Wire, signal: Signal, absent: Set[Signal], inverted: Set[Signal]) -> Wire:
    """Return a wire of a rig on which ``signal`` may be absent or inverted."""
    if signal in absent or wire is Wire.OPEN:
        return Wire.OPEN
    if wire is Wire.LOW or signal not in inverted:
        return wire
    return Wire.DRAWN if wire is Wire.INVERTED else Wire.INVERTED


def wire_level(wire: Wire, level: bool) -> bool:
    """Return the level at the board's end of a wire whose sensor gives ``level`` as drawn."""
    return wire is Wire.OPEN or (wire is not Wire.LOW and level != (wire is Wire.INVERTED))
