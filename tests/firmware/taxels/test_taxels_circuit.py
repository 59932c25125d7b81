"""The three taxels of an input load each other: chips, virtual boards and the formula agree."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from rigctl.bench.bench import Bench
from rigctl.bench.parameters import WorldParameters
from rigctl.bench.skin import SLOT_US
from tests.firmware.taxels.chip import TaxelChip, counts_of

DIVIDER_OHM, PRESSED_OHM, REST_OHM = 10e3, 5e3, 200e3


def read_by_chip(conductances: NDArray[np.float64]) -> NDArray[np.uint16]:
    """Return the last frame (18,) of the firmware's image on its simulated chip."""
    with TaxelChip() as board:
        board.chip.analog[0] = conductances
        board.run(5)
        return board.blocks[-1].samples[-1]


def read_by_virtual_board(conductances: NDArray[np.float64]) -> NDArray[np.uint16]:
    """Return a frame (18,) of the skin that virtual boards, synth and the finger read."""
    bench = Bench(WorldParameters(adc_noise_counts=0.0), 0)
    bench.skin.conductances[:] = conductances
    return bench.skin.read(0, np.array([5000.0]), float(SLOT_US))[0]


@pytest.mark.parametrize(
    ("ohms", "expected"),
    [
        ((PRESSED_OHM, np.inf, np.inf), 682),
        ((PRESSED_OHM, REST_OHM, REST_OHM), 660),
        ((PRESSED_OHM, PRESSED_OHM, PRESSED_OHM), 292),
    ],
)
def test_a_pressed_taxel_reads_less_with_its_neighbours(
    ohms: tuple[float, float, float], expected: int
) -> None:
    """Of the lines of one input the first is read; the others hang low through their taxels."""
    conductances = np.repeat(DIVIDER_OHM / np.array(ohms), 6)
    assert read_by_chip(conductances)[:6].tolist() == [expected] * 6
    assert read_by_virtual_board(conductances)[:6].tolist() == [expected] * 6


def test_chips_and_virtual_boards_read_the_same() -> None:
    random = np.random.default_rng(1)
    for _ in range(20):
        conductances = random.exponential(0.4, 18)
        expected = counts_of(conductances)
        assert np.array_equal(read_by_chip(conductances), expected)
        assert np.array_equal(read_by_virtual_board(conductances), expected)
