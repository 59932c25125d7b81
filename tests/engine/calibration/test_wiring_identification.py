"""The order of the taxels from presses; contradictions are refused."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from rigctl.engine.wiring_identification import PER_LAYER, WiringIdentification
from rigctl.errors import WrongUse
from rigctl.values import DRAWN_WIRING
from tests.engine.calibration.pressed_sensor import PressedSensor, wiring_of

ALL = range(PER_LAYER)


def found(sensor: PressedSensor, order: WiringIdentification | None = None) -> WiringIdentification:
    order = order or WiringIdentification()
    order.add_unplugged_press(sensor.rest(unplugged=True), sensor.press(ALL, unplugged=True))
    for place in ALL:
        order.add_press(sensor.rest(), sensor.press([place]))
    return order


@given(
    st.permutations(range(3)),
    st.permutations(range(6)),
    st.booleans(),
    st.floats(0, 400),
    st.integers(0, 2**16),
)
def test_any_lines_and_inputs_are_found(
    lines: list[int], inputs: list[int], turned: bool, rest: float, seed: int
) -> None:
    wiring = wiring_of(lines, inputs, turned)
    assert found(PressedSensor(wiring, rest=rest, seed=seed)).wiring() == wiring


def test_a_sensor_soldered_as_drawn_is_the_default() -> None:
    assert wiring_of([0, 1, 2], [0, 1, 2, 3, 4, 5], False) == DRAWN_WIRING
    order = found(PressedSensor(DRAWN_WIRING))
    assert order.wiring() == DRAWN_WIRING
    assert (order.upper, order.lower) == ((0, 1, 2), (3, 4, 5))


def test_pressure_that_lowers_a_reading_is_as_good() -> None:
    assert found(PressedSensor(DRAWN_WIRING, rest=900, force=-300)).wiring() == DRAWN_WIRING


def pressed(order: WiringIdentification, sensor: PressedSensor, places: list[int]) -> str:
    return order.add_press(sensor.rest(), sensor.press(places))


def changes(**by_reading: float) -> NDArray[np.float64]:
    made = np.zeros(18)
    for name, counts in by_reading.items():
        made[int(name[1:])] = counts
    return made


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_a_layer_is_three_silent_inputs(share: float) -> None:
    order = WiringIdentification()
    with pytest.raises(WrongUse, match="a layer has three inputs"):
        order.add_unplugged_press(np.zeros(18), np.full(18, 300 * share))
    assert order.upper == order.lower == ()


def test_each_press_is_described() -> None:
    order, sensor = WiringIdentification(), PressedSensor(DRAWN_WIRING)
    sentence = order.add_unplugged_press(
        sensor.rest(unplugged=True), sensor.press(ALL, unplugged=True)
    )
    assert sentence == "top layer: inputs A0, A1, A2; bottom layer: inputs A3, A4, A5"
    assert pressed(order, sensor, [0]).startswith("row 1, column 1: D4·A0 by ")


def test_an_unclear_or_repeated_press_is_refused() -> None:
    order, sensor = WiringIdentification(), PressedSensor(DRAWN_WIRING)
    order.add_unplugged_press(sensor.rest(unplugged=True), sensor.press(ALL, unplugged=True))
    with pytest.raises(WrongUse, match="no taxel of the top layer responded: press harder"):
        pressed(order, sensor, [])
    with pytest.raises(WrongUse, match="responded alike: press one place only"):
        pressed(order, sensor, [0, 1])
    with pytest.raises(WrongUse, match="no taxel of the bottom layer"):
        order.add_press(np.zeros(18), changes(r0=300))
    pressed(order, sensor, [0])
    with pytest.raises(WrongUse, match=r"D4·A0 responded, as it did at row 1, column 1: press row"):
        pressed(order, sensor, [0])
    assert order.place == 1


def test_mixed_up_places_are_refused() -> None:
    order, sensor = WiringIdentification(), PressedSensor(DRAWN_WIRING)
    order.add_unplugged_press(sensor.rest(unplugged=True), sensor.press(ALL, unplugged=True))
    for place in [0, 1, 2, 3, 5, 4, 6, 7, 8]:
        pressed(order, sensor, [place])
    with pytest.raises(WrongUse, match="do not form rows of one line"):
        order.wiring()
