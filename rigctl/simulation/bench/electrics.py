"""The electrical layer of the bench: what lies between its mechanics and the boards' pins.

A :class:`Circuit` says how supply, drivers, sensors and boards are connected; its defaults are the
drawing in ``arduino/README.md``. :func:`constants` turns it into an array for compiled code, which
computes the actuator's voltage and the levels at the drum board's inputs. Both kinds of boards use
these functions. ``rigctl.simulation.wirings`` lists the circuits that people build by mistake.
"""

from __future__ import annotations

import math
from collections.abc import Set
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.simulation.bench.numba_options import compiled, inlined
from rigctl.values import N_TAXELS
from rigctl.wire.drum.codes import Signal

END_MM = 0.05
"""Distance to the actuator's end at which the end switch opens."""

POTENTIOMETER_OHM, SERIES_OHM, PULL_DOWN_OHM = 10_000.0, 470.0, 1e6
"""The potentiometer, the resistor at each of its ends, and the one from its wiper to ground. Travel
reads 44 to 978 of 1023: whichever wire breaks, the reading leaves this range at every position."""

NO_DIVIDER = 1e6
"""Conductance of a taxel without a divider beside it, as a multiple."""

N_LINES, N_INPUTS = 3, 6
_FLOATING, _WANDER, _WANDER_MS = 0.37, 0.02, 1700.0


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

    Actuator: ``actuator_polarity`` −1 with its two wires exchanged; ``press_half`` and ``lift_half``
    of the bridge work; ``bridge_held_on``: its enable is high whatever the board says.

    Potentiometer: ``wiper``; ``is_position_reversed``; its ``ground_end`` and ``supply_end`` are
    connected; ``pull_down`` is fitted.

    Switches: ``estop``, ``upper_end``, ``lower_end``; ``ends_swapped``; ``switch_noise``: short
    spikes on all three wires.

    Load cell: of the signal a share ``cell_gain`` arrives, negative with exchanged wires, with
    ``cell_stray_counts`` and ``cell_noise_counts`` (rms) of other origin; a conversion takes
    ``cell_periods`` nominal periods; ``cell_clock`` and ``cell_data`` are connected; every
    ``cell_spike_every``-th conversion, if that is not 0, is wrong by :data:`SPIKE_G`.

    Stepper: ``coils`` are paired as drawn; ``step`` is connected; ``enable``; ``direction``; a pulse
    turns the drum by ``step_size`` steps; the surface moves by ``diameter`` times the nominal travel.

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
    lines: tuple[int, ...] = tuple(range(N_LINES))
    inputs: tuple[int, ...] = tuple(range(N_INPUTS))
    open_lines: tuple[int, ...] = ()
    open_inputs: tuple[int, ...] = ()
    shorted_inputs: tuple[int, ...] = ()
    missing_dividers: tuple[int, ...] = ()
    ports: tuple[str, str] = ("drum", "taxels")

    def has_supply(self, estop_pressed: bool) -> bool:
        """Return whether the second contact of the emergency stop lets the supplies through."""
        return not (estop_pressed and self.stop_cuts_supply)

    def motor_turns(self, estop_pressed: bool) -> bool:
        """Return whether the motor follows pulses while the board has switched its driver on."""
        powered = self.motor_supply > 0.0 and self.has_supply(estop_pressed)
        return powered and self.coils and self.step and self.enable is Wire.DRAWN


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


# Plain arrays with named indices, as in the mechanics.
PRESS, LIFT, _WIPER, _REVERSED, _GROUND_END, _SUPPLY_END, _PULL_DOWN_S = range(7)
END_UP, _UP_WIRE, END_DOWN, _DOWN_WIRE, _UPPER_HELD, _LOWER_HELD = range(7, 13)
CELL_CLOCK_OPEN, _SIZE = range(13, 15)
"""Indices of the constants ``e``, float64."""

_Floats = NDArray[np.float64]


def constants(
    circuit: Circuit,
    absent: Set[Signal] = frozenset(),
    inverted: Set[Signal] = frozenset(),
    estop_pressed: bool = False,
    held_ends: tuple[bool, bool] = (False, False),
) -> _Floats:
    """Return the constants of a circuit, float64 (14,), for the functions below.

    ``absent``: optional wires of the drum board that the rig does not have; ``inverted``: those with
    the opposite polarity. ``held_ends``: a hand holds the upper or the lower end switch.
    """
    has_position = Signal.POSITION not in absent
    voltage = circuit.actuator_polarity * circuit.actuator_supply
    voltage *= circuit.has_supply(estop_pressed)
    wires = {
        "up": wire_of(circuit.upper_end, Signal.END_SWITCHES, absent, inverted),
        "down": wire_of(circuit.lower_end, Signal.END_SWITCHES, absent, inverted),
    }
    e = np.zeros(_SIZE)
    e[[PRESS, LIFT]] = voltage * circuit.press_half, voltage * circuit.lift_half
    e[_WIPER] = circuit.wiper if has_position else Wiper.OPEN
    e[_REVERSED] = circuit.is_position_reversed != (Signal.POSITION in inverted)
    e[[_GROUND_END, _SUPPLY_END]] = circuit.ground_end, circuit.supply_end
    e[_PULL_DOWN_S] = (circuit.pull_down and has_position) / PULL_DOWN_OHM
    e[[END_UP, END_DOWN]] = circuit.ends_swapped, not circuit.ends_swapped
    e[[_UP_WIRE, _DOWN_WIRE]] = wires["up"], wires["down"]
    e[[_UPPER_HELD, _LOWER_HELD]] = held_ends
    e[CELL_CLOCK_OPEN] = not circuit.cell_clock
    return e


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


@inlined
def terminal_drive(e: _Floats, duty: float) -> float:
    """Return the actuator's voltage as a share of the nominal supply, positive presses."""
    return float(duty * (e[PRESS] if duty > 0.0 else e[LIFT]))


@inlined
def end_level(e: _Floats, end: int, rod_mm: float, travel_mm: float) -> bool:
    """Return the level at the input of :data:`END_UP` or :data:`END_DOWN`; high is at the end."""
    if e[end] == 0.0:
        at_end = rod_mm < END_MM or e[_UPPER_HELD] != 0.0
    else:
        at_end = rod_mm > travel_mm - END_MM or e[_LOWER_HELD] != 0.0
    wire = e[end + 1]
    return bool(wire == 2.0 or (wire != 3.0 and at_end != (wire == 1.0)))


@inlined
def wiper_share(e: _Floats, share: float, time_ms: float) -> float:
    """Return the voltage at the potentiometer's input as a share of the reference.

    ``share``: of the travel from its upper end. A wiper that hangs on nothing wanders.
    """
    if e[_WIPER] == 2.0:
        return 0.0
    if e[_WIPER] == 3.0:
        return 1.0
    place = 1.0 - share if e[_REVERSED] else share
    down, up = e[_PULL_DOWN_S], 0.0
    if e[_WIPER] == 0.0 and e[_GROUND_END]:
        down += 1.0 / (SERIES_OHM + place * POTENTIOMETER_OHM)
    if e[_WIPER] == 0.0 and e[_SUPPLY_END]:
        up = 1.0 / (SERIES_OHM + (1.0 - place) * POTENTIOMETER_OHM)
    if up + down == 0.0:
        return _FLOATING + _WANDER * math.sin(2.0 * math.pi * time_ms / _WANDER_MS)
    return float(up / (up + down))


def terminal_voltage(e: _Floats, duty: float) -> float:
    """Return :func:`terminal_drive` without compiled code around it."""
    return float(duty * (e[PRESS] if duty > 0.0 else e[LIFT]))


@compiled
def _actuator_pins(
    e: _Floats, rod_mm: float, travel_mm: float, time_ms: float
) -> tuple[float, bool, bool]:
    up, down = (end_level(e, END_UP, rod_mm, travel_mm), end_level(e, END_DOWN, rod_mm, travel_mm))
    return wiper_share(e, rod_mm / travel_mm, time_ms), up, down


def actuator_pins(
    e: _Floats, rod_mm: float, travel_mm: float, time_ms: float = 0.0
) -> tuple[float, bool, bool]:
    """Return the potentiometer's share of the reference and the levels of both end switches."""
    share, up, down = _actuator_pins(e, rod_mm, travel_mm, float(time_ms))
    return float(share), bool(up), bool(down)


def taxel_map(circuit: Circuit, has_network: bool) -> _Floats | None:
    """Return how conductances at the board's readings follow from those as drawn, (18, 18).

    None for a sensor that is wired as drawn. ``has_network``: the board computes the voltages at its
    inputs itself, with shorted inputs and missing dividers.
    """
    by_reading = np.zeros((N_TAXELS, N_TAXELS))
    for reading in range(N_TAXELS):
        line, at = divmod(reading, N_INPUTS)
        if line not in circuit.open_lines and at not in circuit.open_inputs:
            by_reading[reading, circuit.lines[line] * N_INPUTS + circuit.inputs[at]] = 1.0
    if not has_network:
        _join_inputs(by_reading, circuit)
    return None if np.array_equal(by_reading, np.eye(N_TAXELS)) else by_reading


def _join_inputs(by_reading: _Floats, circuit: Circuit) -> None:
    """Put shorted inputs at one voltage, and leave out dividers that are missing.

    Inputs in parallel with their dividers have the voltage of one input with the mean conductance.
    """
    for line in range(N_LINES):
        joined = [line * N_INPUTS + at for at in circuit.shorted_inputs]
        if joined:
            by_reading[joined] = by_reading[joined].mean(axis=0)
        by_reading[[line * N_INPUTS + at for at in circuit.missing_dividers]] *= NO_DIVIDER
