"""The simulated compare unit leaves no match out: a stepper would stand still for 4 ms."""

from __future__ import annotations

import numpy as np

from rigctl.simulation.chips.simavr import Chip, Kind, Output, load_library
from tests.firmware.building import built

ROUND = 65_536
ROUNDS = 400
LONGEST_INSTRUCTION = 5
PLACES = 8
"""First cycles of a round in which the probe's matches lie."""


def test_a_match_right_behind_the_overflow_comes_in_its_round() -> None:
    chip = Chip(
        load_library(built("sim/libchips.so")), built("firmware/probe-compare.elf"), Kind.DRUM
    )
    chip.io.report_steps = 1
    rises: list[int] = []
    while chip.io.cycle < ROUNDS * ROUND:
        chip.run(int(chip.io.cycle) + 16_000)
        signals = chip.edge_signal[: chip.io.edge_count]
        rises += chip.edge_cycle[: chip.io.edge_count][signals == Output.STEP].tolist()
    chip.close()
    apart = np.diff(rises)
    assert len(rises) >= ROUNDS - 2
    assert np.abs(apart - ROUND).max() <= PLACES + LONGEST_INSTRUCTION
