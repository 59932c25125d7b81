"""The drum controller's timing in cycles: pulses, interrupts, load-cell reads, replies."""

from __future__ import annotations

import struct
from collections.abc import Iterator

import numpy as np
import pytest

from rigctl.bench.chips.simavr import Input, Output
from rigctl.boards.drum_codes import Command
from rigctl.boards.drum_states import State
from tests.firmware.drum.support.chip import ENTRY_CYCLES, DrumChip

STEP_CYCLES_AT_1_MM_S = 16e6 * 0.03125
JITTER_CYCLES = 5
"""Jitter of an edge due to the simulator, which stops between instructions."""


@pytest.fixture(scope="module")
def holding() -> Iterator[DrumChip]:
    """Yield a drum that holds 500 g."""
    with DrumChip() as drum:
        drum.arm()
        drum.hold(500)
        yield drum


def trial(drum: DrumChip, speed_mm_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Run once; return the cycles of all steps, and the edges (cycle, level) of sync."""
    drum.set("speed_set", round(speed_mm_s * 100))
    drum.clear_edges()
    assert drum.command(Command.RUN, 12_000) == 0
    assert drum.state is State.HOLD
    return drum.steps(), drum.edges(Output.SYNC)


@pytest.mark.parametrize("speed_mm_s", [40.0, 73.7, 120.0])
def test_a_run_has_exact_steps_and_pulse_times(holding: DrumChip, speed_mm_s: float) -> None:
    steps, sync = trial(holding, speed_mm_s)
    wanted = STEP_CYCLES_AT_1_MM_S / speed_mm_s
    opened, closed = (int(np.searchsorted(steps, c, "right")) for c in sync[:, 0])
    assert sync[:, 1].tolist() == [1, 0]
    assert (opened, closed) == (3200, 3200 + 7840)
    inside = steps[opened - 1 : closed]
    intervals = np.diff(inside)
    assert np.abs(intervals - wanted).max() <= JITTER_CYCLES + 1
    assert intervals.mean() / wanted == pytest.approx(1.0, abs=5e-6)
    assert sync[0, 0] - steps[opened - 1] < 400  # sync follows its step within 25 µs
    assert sync[1, 0] - steps[closed - 1] < 400


def test_the_clock_trim_slows_the_pulses(holding: DrumChip) -> None:
    holding.set("clock_trim_ppm", 1200)
    steps, _ = trial(holding, 80.0)
    holding.set("clock_trim_ppm", 0)
    mean = np.diff(steps[3000:9000]).mean()
    assert mean / (STEP_CYCLES_AT_1_MM_S / 80.0) == pytest.approx(1.0012, abs=5e-6)


def test_ramps_have_the_acceleration_set(holding: DrumChip) -> None:
    steps, _ = trial(holding, 120.0)
    seconds = (steps[300] - steps[0]) / 16e6 + np.sqrt(2 * 0.03125 / 600)
    assert 2 * 301 * 0.03125 / seconds**2 == pytest.approx(600, rel=0.01)


def test_interrupts_and_load_cell_reads_are_short(holding: DrumChip) -> None:
    x = holding.x
    x.watch_interrupts = 1
    trial(holding, 120.0)
    x.watch_interrupts = 0
    longest = max(x.longest_isr) + ENTRY_CYCLES
    assert longest <= 400, list(x.longest_isr)  # 25 µs
    assert x.longest_off <= 160  # 10 µs
    assert x.longest_read <= 960  # 60 µs
    assert x.loadcell_latency <= 16_000  # 1 ms
    assert x.loadcell_reads == x.loadcell_conversions
    assert holding.get("longest_isr_us") == pytest.approx(longest / 16, abs=4)
    assert holding.get("late_ticks") < 1e-3 * x.cycle / 16_000
    assert holding.get("loadcell_dropped") == 0


def test_the_longest_modbus_read_delays_no_conversion(holding: DrumChip) -> None:
    for _ in range(20):
        holding.beat()
        holding.exchange(struct.pack(">BHH", 3, 128, 125))
    assert holding.x.loadcell_latency <= 16_000
    assert holding.x.loadcell_reads == holding.x.loadcell_conversions


def test_the_processor_is_idle_for_half_of_its_time_at_120_mm_s(holding: DrumChip) -> None:
    holding.set("speed_set", 12_000)
    assert holding.command(Command.RUN) == 0
    holding.poll_for(500)
    slept, cycle = holding.x.slept_cycles, holding.x.cycle
    holding.poll_for(1500)
    share = (holding.x.slept_cycles - slept) / (holding.x.cycle - cycle)
    assert share >= 0.5
    assert holding.get("idle_permille") == pytest.approx(1000 * share, abs=60)
    holding.poll_for(1500)
    assert holding.state is State.HOLD


def test_a_long_move_runs_at_ten_thousand_steps_per_second() -> None:
    with DrumChip() as drum:
        drum.arm()
        drum.set("move_speed_set", 32_000)
        drum.set("move_target", 40_000)
        drum.clear_edges()
        assert drum.command(Command.MOVE, 20_000) == 0
        steps = drum.steps()
        assert steps.size == 40_000
        assert drum.get("steps") == 40_000
        fastest = np.diff(steps[18_000:22_000])
        assert np.abs(fastest - STEP_CYCLES_AT_1_MM_S / 320).max() <= JITTER_CYCLES + 1
        assert max(drum.x.longest_isr) + ENTRY_CYCLES <= 400
        assert drum.x.longest_read <= 960
        assert drum.x.loadcell_latency <= 16_000
        assert drum.get("late_ticks") <= 5


def test_replies_begin_within_five_milliseconds(holding: DrumChip) -> None:
    for _ in range(50):
        holding.beat()
        one_byte = round(16e6 * 10 / 115200)
        assert holding.first_reply_cycle - one_byte - holding.last_byte_cycle < 5 * 16_000


def test_a_spike_is_no_index_mark_to_a_drum_that_turns_backwards() -> None:
    with DrumChip() as drum:
        drum.arm()
        drum.set("move_target", -20_000)
        assert drum.command(Command.MOVE) == 0
        drum.poll_for(300)
        marks = drum.get("index_count")
        for _ in range(100):
            drum.pin(Input.MARK, 1, 1000)
            drum.pin(Input.MARK, 0, 1020)
            drum.run(1)
        assert drum.state is State.POSITION
        assert drum.get("index_count") == marks
