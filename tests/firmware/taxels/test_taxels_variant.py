"""A header adapts the image to another wiring: driven low, dividers to 5 V, no drum wires."""

from __future__ import annotations

import numpy as np

from rigctl.bench.chips.simavr import Input
from rigctl.boards.taxel_frames import Coverage, SelfTest
from tests.firmware.taxels.chip import FRAME_CYCLES, TaxelChip

IMAGE = "firmware/taxels-driven-low.elf"
CONDUCTANCES = np.arange(1, 19) / 12


def variant() -> TaxelChip:
    """Return the variant with a matching sensor."""
    board = TaxelChip(IMAGE)
    board.x.driven_low = 1
    board.chip.analog[0] = CONDUCTANCES
    return board


def test_pressure_lowers_the_reading_of_its_line_and_input() -> None:
    with variant() as board:
        board.run(60)
        # This header has the pins in reverse order.
        conductance = CONDUCTANCES.reshape(3, 6)[::-1, ::-1]
        others = conductance.sum(axis=0) - conductance
        pulls_up = (1 + others) / (1 + others + conductance)
        assert np.abs(board.samples[-1].reshape(3, 6) - 1023 * pulls_up).max() <= 1
        assert np.abs(np.diff(board.sampled(0)) - FRAME_CYCLES).max() <= 2


def test_its_self_test_reports_its_reduced_coverage() -> None:
    with variant() as board:
        board.run(60)
        assert board.tests == [SelfTest(1, Coverage.LINES | Coverage.TAXELS)]


def test_its_self_test_finds_lines_and_inputs() -> None:
    with variant() as board:
        board.x.lines_low = 0b001
        board.x.inputs_low = 0b100000
        board.run(60)
        (outcome,) = board.tests
        # D4 is this header's third line, A5 its first input.
        assert (outcome.lines_low, outcome.lines_high, outcome.lines_together) == (0b100, 0, 0)
        assert outcome.inputs_high & 0b1  # the dividers pull to 5 V, so the fault reads as high


def test_missing_sync_and_index_wires_are_ignored() -> None:
    with variant() as board:
        board.run(60)
        for signal in (Input.SYNC, Input.INDEX):
            board.edge(signal, 1, board.x.cycle + 100)
            board.run(3)
        board.run(100)
        assert not board.flags.any() and not board.edges.any()
        assert board.statuses[-1].sync_rises == 0
