"""The simulated chips: load-cell amplifier, bridge, compare unit, and the end of a slice."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from rigctl.bench.chips.simavr import Chip, Kind, Output, load_library
from rigctl.boards.drum_codes import Command
from tests.firmware.building import built
from tests.firmware.drum.support.plant_drum import PlantDrum

PERIOD = 200_000  # cycles: 12.5 ms
NORMAL, SILENT, FROZEN, SATURATED = range(4)


class Probe:
    """A chip that reads the amplifier and sends the readings."""

    def __init__(self) -> None:
        library = load_library(built("sim/libchips.so"))
        self.chip = Chip(library, built("firmware/probe-hx711.elf"), Kind.DRUM)
        self.x = self.chip.io
        self.x.loadcell_period_q16 = PERIOD << 16
        self.x.host_byte_q16 = 1389 << 16

    def read(self, periods: float, send: bytes = b"") -> list[int]:
        """Run for some periods; return the conversions that the chip has read."""
        received = b""
        if send:
            self.chip.send(send)
        end = self.x.cycle + round(periods * PERIOD)
        while self.x.cycle < end:
            self.chip.run(min(end, self.x.cycle + 16_000))
            received += self.chip.tx[: self.x.tx_count].tobytes()
        words = (received[i : i + 3] for i in range(0, len(received) - 2, 3))
        return [int.from_bytes(word, "big", signed=True) for word in words]


@pytest.fixture
def probe() -> Iterator[Probe]:
    """Yield a probe that has read its first conversion."""
    probe = Probe()
    probe.x.loadcell_counts = 100
    assert probe.read(4.5) == [100]
    yield probe
    probe.chip.close()


@pytest.mark.parametrize("counts", [0, 1, -1, 123_456, -123_456, 8_388_607, -8_388_608])
def test_every_bit_arrives(probe: Probe, counts: int) -> None:
    probe.x.loadcell_counts = counts
    assert probe.read(3) == [counts] * 3
    assert probe.x.loadcell_reads == probe.x.loadcell_conversions == 4


def test_the_first_conversion_comes_after_four_periods() -> None:
    probe = Probe()
    probe.x.loadcell_counts = 7
    assert probe.read(3.9) == []
    assert probe.read(0.2) == [7]
    probe.chip.close()


def test_beyond_the_range_it_saturates(probe: Probe) -> None:
    probe.x.loadcell_counts = 9_000_000
    assert probe.read(1) == [8_388_607]


def test_another_gain_takes_four_periods_and_halves_the_reading(probe: Probe) -> None:
    probe.x.loadcell_counts = 1000
    assert probe.read(1, b"3") == [1000]  # this read selects the gain of the next
    assert probe.read(3.5) == []
    assert probe.read(2) == [500, 500]


def test_a_long_clock_powers_it_down_and_it_settles_again(probe: Probe) -> None:
    assert probe.read(3.8, b"p") == []
    assert probe.read(1) == [100]


def test_faults_have_the_readings_of_a_real_amplifier(probe: Probe) -> None:
    probe.x.loadcell_mode = FROZEN
    probe.x.loadcell_counts = 555
    assert probe.read(2) == [100, 100]
    probe.x.loadcell_mode = SATURATED
    assert probe.read(2) == [8_388_607] * 2
    probe.x.loadcell_mode = SILENT
    assert probe.read(3) == []
    probe.x.loadcell_mode = NORMAL
    assert probe.read(1) == [555]


ONE_STEP = 0.05
"""Permille: a fifth of one count of the timer."""


def test_the_bench_gets_the_duty_that_the_firmware_sets() -> None:
    with PlantDrum() as drum:
        drum.prepare()
        assert drum.command(Command.APPROACH) == 0
        differences = []
        for _ in range(20):
            drum.poll_for(50)
            differences.append(drum.get("actuator_drive") - 1000 * drum.x.drive)
        # The register holds the newest duty; the bench gets the mean of a millisecond.
        assert min(map(abs, differences)) == pytest.approx(0, abs=ONE_STEP)


LONGEST_CYCLES = 5
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
    assert max(overruns) < LONGEST_CYCLES
    chip.close()


OVERFLOW_CYCLES = 65_536
PERIODS = 400
MATCH_CYCLES = 8
"""The probe's matches are within this many cycles after an overflow."""


def test_a_match_right_after_the_overflow_occurs_in_its_period() -> None:
    chip = Chip(
        load_library(built("sim/libchips.so")), built("firmware/probe-compare.elf"), Kind.DRUM
    )
    chip.io.report_steps = 1
    rises: list[int] = []
    while chip.io.cycle < PERIODS * OVERFLOW_CYCLES:
        chip.run(int(chip.io.cycle) + 16_000)
        signals = chip.edge_signal[: chip.io.edge_count]
        rises += chip.edge_cycle[: chip.io.edge_count][signals == Output.STEP].tolist()
    chip.close()
    intervals = np.diff(rises)
    assert len(rises) >= PERIODS - 2
    assert np.abs(intervals - OVERFLOW_CYCLES).max() <= MATCH_CYCLES + LONGEST_CYCLES
