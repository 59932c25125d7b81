"""The electrical layer of the bench: what lies between its mechanics and the boards' pins.

A :class:`~rigctl.bench.circuit.Circuit` says how the bench is connected.
:func:`constants` turns it into an array for compiled code, which computes the actuator's voltage
and the levels at the drum board's inputs. Both kinds of boards use these functions.
"""

from __future__ import annotations

import math
from collections.abc import Sequence, Set

import numpy as np
from numpy.typing import NDArray

from rigctl.bench.circuit import Circuit, Wiper, wire_of
from rigctl.boards.drum_codes import Signal
from rigctl.config.rig_config import TaxelArray
from rigctl.kernels import compiled, inlined

END_MM = 0.05
"""Distance to the actuator's end at which the end switch opens."""

POTENTIOMETER_OHM, SERIES_OHM, PULL_DOWN_OHM = 10_000.0, 470.0, 1e6
"""The potentiometer, the resistor at each of its ends, and the one from its wiper to ground. Travel
reads 44 to 978 of 1023: whichever wire breaks, the reading leaves this range at every position."""

NO_DIVIDER = 1e6
"""Conductance of a taxel without a divider beside it, as a multiple."""

_FLOATING, _WANDER, _WANDER_MS = 0.37, 0.02, 1700.0


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
    has_supply: bool = True,
    held_ends: tuple[bool, bool] = (False, False),
) -> _Floats:
    """Return the constants of a circuit, float64 (14,), for the functions below.

    ``absent``: optional wires of the drum board that the rig does not have; ``inverted``: those
    with the opposite polarity. ``has_supply``: the emergency stop has not cut it. ``held_ends``: a
    hand holds the upper or the lower end switch.
    """
    has_position = Signal.POSITION not in absent
    voltage = circuit.actuator_polarity * circuit.actuator_supply
    voltage *= has_supply
    upper, lower = (
        wire_of(wire, Signal.END_SWITCHES, absent, inverted)
        for wire in (circuit.upper_end, circuit.lower_end)
    )
    e = np.zeros(_SIZE)
    e[[PRESS, LIFT]] = voltage * circuit.press_half, voltage * circuit.lift_half
    e[_WIPER] = circuit.wiper if has_position else Wiper.OPEN
    e[_REVERSED] = circuit.is_position_reversed != (Signal.POSITION in inverted)
    e[[_GROUND_END, _SUPPLY_END]] = circuit.ground_end, circuit.supply_end
    e[_PULL_DOWN_S] = (circuit.pull_down and has_position) / PULL_DOWN_OHM
    e[[END_UP, END_DOWN]] = circuit.ends_swapped, not circuit.ends_swapped
    e[[_UP_WIRE, _DOWN_WIRE]] = (lower, upper) if circuit.ends_swapped else (upper, lower)
    e[[_UPPER_HELD, _LOWER_HELD]] = held_ends
    e[CELL_CLOCK_OPEN] = not circuit.cell_clock
    return e


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


def taxel_map(circuit: Circuit, has_network: bool, sensor: TaxelArray) -> _Floats | None:
    """Return how conductances at the board's readings follow from those as drawn, (n, n).

    None for a sensor that is wired as drawn. ``has_network``: the board computes the voltages at
    its inputs itself, with shorted inputs and missing dividers. What leads to a line or input that
    the sensor does not have is open.
    """
    n_inputs = sensor.inputs
    by_reading = np.zeros((sensor.count, sensor.count))
    for reading in range(sensor.count):
        line, at = divmod(reading, n_inputs)
        if line not in circuit.open_lines and at not in circuit.open_inputs:
            line, at = _leads_to(circuit.lines, line), _leads_to(circuit.inputs, at)
            if at < n_inputs and line < sensor.count // n_inputs:
                by_reading[reading, line * n_inputs + at] = 1.0
    if not has_network:
        _join_inputs(by_reading, circuit, n_inputs)
    return None if np.array_equal(by_reading, np.eye(sensor.count)) else by_reading


def _leads_to(order: Sequence[int], wire: int) -> int:
    """Return where a wire leads; those beyond the drawing's lead to their own place."""
    return order[wire] if wire < len(order) else wire


def _join_inputs(by_reading: _Floats, circuit: Circuit, n_inputs: int) -> None:
    """Put shorted inputs at one voltage, and leave out dividers that are missing.

    Inputs in parallel with their dividers have the voltage of one input with the mean conductance.
    """
    shorted, missing = (
        [at for at in inputs if at < n_inputs]
        for inputs in (circuit.shorted_inputs, circuit.missing_dividers)
    )
    for first in range(0, len(by_reading), n_inputs):
        joined = [first + at for at in shorted]
        if joined:
            by_reading[joined] = by_reading[joined].mean(axis=0)
        by_reading[[first + at for at in missing]] *= NO_DIVIDER
