"""A slice ends at the requested cycle, because the simulation reads the drum's place there."""

from __future__ import annotations

import pytest

from rigctl.bench.chips.simavr import Chip, Kind, load_library
from tests.firmware.building import built

LONGEST_INSTRUCTION = 5
BOOTED = 200 * 16_000
SLICES = 20_000
"""Slices of one cycle, so that every instruction ends a slice, also those that start a sleep."""


@pytest.mark.parametrize("kind", Kind, ids=lambda kind: kind.name.lower())
def test_a_chip_that_sleeps_at_the_end_of_a_slice_does_not_overrun_it(kind: Kind) -> None:
    image = built(f"firmware/{kind.name.lower()}.elf")
    chip = Chip(load_library(built("sim/libchips.so")), image, kind)
    x = chip.io
    chip.run(BOOTED)
    slept, overruns = x.slept_cycles, []
    for _ in range(SLICES):
        end = x.cycle + 1
        chip.run(end)
        overruns.append(x.cycle - end)
    assert x.slept_cycles > slept
    assert max(overruns) < LONGEST_INSTRUCTION
    chip.close()
