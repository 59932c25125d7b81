"""Every edge of sync and index is counted in the frame in which it occurs."""

from __future__ import annotations

import numpy as np
import pytest

from rigctl.bench.chips.simavr import Input
from rigctl.boards.taxel_frames import Flag
from tests.firmware.taxels.chip import FRAME_CYCLES, TaxelChip

UNSURE_CYCLES = 4
"""An edge within one instruction of a frame's boundary may count in either frame."""


def frame_of_rise(board: TaxelChip, counts: np.ndarray, before: int) -> int:
    """Return the counter of the first frame after row ``before`` whose edge count changed."""
    changed = np.flatnonzero(np.diff(counts[before:].astype(int)))
    return int(board.counters[before + changed[0] + 1])


@pytest.mark.parametrize("input_", [Input.SYNC, Input.INDEX])
def test_an_edge_counts_in_the_frame_in_which_it_rises(input_: Input) -> None:
    shift = 0 if input_ is Input.SYNC else 2
    # Hardware timestamps sync; other interrupts delay the index by at most 25 µs.
    unsure = UNSURE_CYCLES if input_ is Input.SYNC else 400
    offsets = [-3000, -800, -401, -60, -20, -6, 6, 20, 60, 200, 430, 470, 800, 8000, 12345]
    with TaxelChip() as board:
        board.run(20)
        for offset in (o for o in offsets if abs(o) > unsure):
            board.run(8)
            boundary = int(board.sampled(0)[-1]) + 3 * FRAME_CYCLES
            first_counter = board.sampled(0).size - 1 + 3
            seen = board.counters.size - 1
            board.edge(input_, 1, boundary + offset)
            board.edge(input_, 0, boundary + offset + 2 * FRAME_CYCLES)
            board.run(10)
            expected = first_counter + (offset // FRAME_CYCLES)
            counts = board.edges >> shift & 3
            assert frame_of_rise(board, counts, seen) == expected, offset


def test_the_sync_flag_is_the_level_at_the_end_of_the_frame() -> None:
    with TaxelChip() as board:
        board.run(20)
        boundary = int(board.sampled(0)[-1]) + 3 * FRAME_CYCLES
        counter = board.sampled(0).size - 1 + 3
        board.edge(Input.SYNC, 1, boundary + 500)
        board.edge(Input.SYNC, 0, boundary + 5 * FRAME_CYCLES + 500)
        board.run(15)
        high = board.counters[(board.flags & Flag.SYNC) != 0]
        assert np.array_equal(high, np.arange(counter, counter + 5))


def test_the_index_flag_is_set_in_the_frame_in_which_the_mark_begins() -> None:
    with TaxelChip() as board:
        board.run(20)
        boundary = int(board.sampled(0)[-1]) + 3 * FRAME_CYCLES
        counter = board.sampled(0).size - 1 + 3
        board.edge(Input.INDEX, 1, boundary + 5000)
        board.edge(Input.INDEX, 0, boundary + 3 * FRAME_CYCLES)
        board.run(10)
        assert np.array_equal(board.counters[(board.flags & Flag.INDEX) != 0], [counter])


def test_edges_are_counted_while_frames_are_lost() -> None:
    with TaxelChip("firmware/taxels-slow-wire.elf") as slow:
        slow.run(50)
        for _ in range(25):
            slow.edge(Input.SYNC, 1, slow.x.cycle + 1000)
            slow.edge(Input.SYNC, 0, slow.x.cycle + 5000)
            slow.run(8)
        slow.run(120)
        assert slow.statuses[-1].sync_rises == 25
        assert slow.edges[-1] & 3 == 25 % 4
