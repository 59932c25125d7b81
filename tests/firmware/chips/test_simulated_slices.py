"""A slice ends where it was asked to end: the world takes the drum's place at that moment."""

from __future__ import annotations

import pytest

from rigctl.simulation.chips.simavr import Chip, Kind, load_library
from tests.firmware.building import built

LONGEST_INSTRUCTION = 5
BOOTED = 200 * 16_000
SLICES = 20_000
"""Of one cycle each, so that every instruction ends a slice: each one that falls asleep, too."""


@pytest.mark.parametrize("kind", Kind, ids=lambda kind: kind.name.lower())
def test_a_chip_that_falls_asleep_at_a_slices_end_sleeps_no_further(kind: Kind) -> None:
    image = built(f"firmware/{kind.name.lower()}.elf")
    chip = Chip(load_library(built("sim/libchips.so")), image, kind)
    x = chip.io
    chip.run(BOOTED)
    slept, past = x.slept_cycles, []
    for _ in range(SLICES):
        end = x.cycle + 1
        chip.run(end)
        past.append(x.cycle - end)
    assert x.slept_cycles > slept
    assert max(past) < LONGEST_INSTRUCTION
    chip.close()
