"""The taxel board sends a frame every 16,000 cycles, samples in its slots, and loses no frame."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from rigctl.boards.taxel_frames import IDENTIFY, SELF_TEST, encode_request
from tests.firmware.taxels.chip import (
    ENTRY_CYCLES,
    FRAME_CYCLES,
    SLOT_CYCLES,
    TaxelChip,
    counts_of,
)

FRAMES = 5000
CONDUCTANCES = np.arange(18) / 20
RAMP = 0.5
"""Conductance of every taxel at the end of a slice."""


@pytest.fixture(scope="module")
def long_run() -> Iterator[TaxelChip]:
    """Yield a board that has sampled for five seconds."""
    with TaxelChip() as board:
        board.chip.analog[0] = CONDUCTANCES
        board.run(FRAMES)
        yield board


def test_frames_begin_every_16000_cycles_without_drift(long_run: TaxelChip) -> None:
    starts = long_run.sampled(0)
    drift = starts - starts[0] - FRAME_CYCLES * np.arange(starts.size)
    assert starts.size > FRAMES - 20
    assert np.abs(drift).max() <= 1  # jitter of the simulator, which does not accumulate


def test_each_taxel_is_sampled_at_its_slot(long_run: TaxelChip) -> None:
    starts = long_run.sampled(0)
    for taxel in range(18):
        at = long_run.sampled(taxel)[: starts.size]
        offset = at - starts[: at.size] - SLOT_CYCLES * taxel
        assert np.abs(offset).max() <= 2, taxel  # both ends jitter by a cycle


def test_no_frame_is_lost_or_late(long_run: TaxelChip) -> None:
    counters = long_run.counters
    assert counters.size > FRAMES - 20
    assert np.all(np.diff(counters) == 1)
    assert not long_run.flags.any()
    assert long_run.rejected == 0
    status = long_run.statuses[-1]
    assert status.frames_dropped == 0 and status.late_slots == 0


def test_a_status_comes_every_hundred_frames(long_run: TaxelChip) -> None:
    assert np.all(np.diff([s.sample_counter for s in long_run.statuses]) == 100)


def test_readings_are_the_voltages_in_taxel_order(long_run: TaxelChip) -> None:
    expected = counts_of(CONDUCTANCES)
    assert len(set(expected.tolist())) == 18
    assert np.array_equal(long_run.samples[100], expected)
    assert np.array_equal(long_run.samples[-1], expected)


def test_a_reading_is_the_voltage_at_its_sample_time() -> None:
    with TaxelChip() as board:
        board.run(20)
        board.x.analog_rows = 2
        board.chip.analog[0], board.chip.analog[1] = 0.0, RAMP
        before = board.sampled(17).size
        slice_start = board.x.cycle
        board.run(1)
        instants = [int(board.sampled(t)[before]) for t in range(18)]
        board.chip.analog[0] = RAMP
        board.run(3)
        shares = (np.array(instants) - slice_start) / FRAME_CYCLES
        inside = (shares > 0) & (shares < 1)
        got = np.concatenate([b.samples for b in board.blocks])
        top = counts_of(np.full(18, RAMP))[0]
        ramp = got[np.argmax((got != 0).any(axis=1) & (got != top).any(axis=1))]
        expected = shares * RAMP / (1 + 3 * shares * RAMP) * 1023
        assert np.abs(ramp[inside] - expected[inside]).max() <= 1.5


def test_the_processor_has_time_left(long_run: TaxelChip) -> None:
    x = long_run.x
    load = (x.isr_cycles + ENTRY_CYCLES * x.isr_count) / x.cycle
    assert load <= 0.35
    assert x.slept_cycles / x.cycle >= 0.40
    assert long_run.statuses[-1].idle_permille >= 400
    assert max(x.longest_isr) + ENTRY_CYCLES <= 400  # 25 µs


def test_the_main_program_disables_interrupts_for_at_most_10_us() -> None:
    with TaxelChip() as board:
        board.run(5)  # after the boot
        board.x.watch_interrupts = 1
        for _ in range(4):
            board.chip.send(encode_request(IDENTIFY) + encode_request(SELF_TEST))
            board.run(60)
        assert 0 < board.x.longest_off + ENTRY_CYCLES <= 160


def test_the_status_agrees_with_the_simulator(long_run: TaxelChip) -> None:
    status = long_run.statuses[-1]
    assert abs(status.longest_isr_cycles - max(long_run.x.longest_isr) - ENTRY_CYCLES) <= 16
    assert abs(status.idle_permille - 1000 * long_run.x.slept_cycles / long_run.x.cycle) < 100
    assert abs(status.supply_mv - 5000) < 30
    assert status.free_stack_bytes > 512


def test_an_image_that_never_clears_the_compare_flag_does_not_sample() -> None:
    with TaxelChip("firmware/taxels-never-clear.elf") as broken:
        broken.run(100)
        assert broken.identities  # the program runs
        assert broken.counters.size == 0


def test_on_a_slow_line_dropped_frames_are_counted_and_sampling_continues() -> None:
    with TaxelChip("firmware/taxels-slow-wire.elf") as slow:
        slow.run(1000)
        starts = slow.sampled(0)
        assert np.abs(np.diff(starts) - FRAME_CYCLES).max() <= 2
        lost = int(np.sum(np.diff(slow.counters) - 1))
        assert lost > 100
        status = slow.statuses[-1]
        dropped_by_then = status.frames_dropped
        assert abs(dropped_by_then - lost) <= 100
        assert slow.flags[-1] >> 4 == 15  # saturated
