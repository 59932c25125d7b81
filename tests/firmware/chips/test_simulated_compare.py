"""The simulated compare unit misses no match; a missed one would stop the stepper for 4 ms."""

from __future__ import annotations

import numpy as np

from rigctl.bench.chips.simavr import Chip, Kind, Output, load_library
from tests.firmware.building import built

PERIOD = 65_536
PERIODS = 400
LONGEST_INSTRUCTION = 5
MATCH_CYCLES = 8
"""The probe's matches are within this many cycles after an overflow."""


def test_a_match_right_after_the_overflow_occurs_in_its_period() -> None:
    chip = Chip(
        load_library(built("sim/libchips.so")), built("firmware/probe-compare.elf"), Kind.DRUM
    )
    chip.io.report_steps = 1
    rises: list[int] = []
    while chip.io.cycle < PERIODS * PERIOD:
        chip.run(int(chip.io.cycle) + 16_000)
        signals = chip.edge_signal[: chip.io.edge_count]
        rises += chip.edge_cycle[: chip.io.edge_count][signals == Output.STEP].tolist()
    chip.close()
    intervals = np.diff(rises)
    assert len(rises) >= PERIODS - 2
    assert np.abs(intervals - PERIOD).max() <= MATCH_CYCLES + LONGEST_INSTRUCTION
