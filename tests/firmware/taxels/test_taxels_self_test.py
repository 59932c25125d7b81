"""The taxel board's self-test finds faults of wires and sensor without disturbing samples."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rigctl.boards.taxel_frames import (
    IDENTIFY,
    SELF_TEST,
    Coverage,
    SelfTest,
    SelfTestBit,
    encode_request,
    findings,
)
from tests.firmware.taxels.chip import FRAME_CYCLES, TaxelChip

TEST_FRAMES = 21
AT_REST = 0.02
"""Conductance of an untouched taxel, in units of the divider's."""
SHORTED = 1e6
ALL = Coverage.LINES | Coverage.OPEN_INPUTS | Coverage.SHORT_INPUTS | Coverage.TAXELS


def outcome_with(conductances: dict[int, float] | None = None, **faults: int) -> SelfTest:
    """Return the outcome at boot with faults of the wiring and some conductances."""
    with TaxelChip() as board:
        board.chip.analog[0] = AT_REST
        for reading, conductance in (conductances or {}).items():
            board.chip.analog[0, reading] = conductance
        for name, lines_or_inputs in faults.items():
            setattr(board.x, name, lines_or_inputs)
        board.run(TEST_FRAMES + 10)
        (outcome,) = board.tests
        return outcome


def test_a_sound_board_passes_at_boot() -> None:
    assert outcome_with() == SelfTest(1, ALL)


@pytest.mark.parametrize(
    ("fault", "expected"),
    [
        ({"lines_low": 0b001}, {"lines_low": 0b001, "silent": 0b111111}),
        ({"lines_together": 0b110}, {"lines_together": 0b110, "silent": 0b111111111111 << 6}),
        ({"inputs_low": 0b10}, {"inputs_low": 0b10, "silent": 1 << 1 | 1 << 7 | 1 << 13}),
        ({"inputs_high": 0b1}, {"inputs_high": 0b1, "full": 1 << 0 | 1 << 6 | 1 << 12}),
        ({"inputs_open": 0b100000}, {"inputs_open": 0b100000}),
        ({"inputs_together": 0b1001}, {"inputs_together": 0b1001}),
    ],
)
def test_a_wiring_fault_is_found(fault: dict[str, int], expected: dict[str, Any]) -> None:
    assert outcome_with(**fault) == SelfTest(1, ALL, **expected)


def test_a_line_at_5_v_is_found_and_no_other() -> None:
    outcome = outcome_with(lines_high=0b100)
    assert (outcome.lines_low, outcome.lines_high, outcome.lines_together) == (0, 0b100, 0)


def test_open_and_shorted_taxels_are_found() -> None:
    outcome = outcome_with({3: 0.0, 16: 0.0, 8: SHORTED})
    silenced_by_the_short = 1 << 2 | 1 << 14
    silent = 1 << 3 | 1 << 16 | silenced_by_the_short
    assert outcome == SelfTest(1, ALL, silent=silent, full=1 << 8)
    sentences = findings(outcome)
    assert [name.split(" ")[1] for name in sentences] == ["10", "17", "6"]


def test_a_touched_sensor_is_no_fault() -> None:
    assert outcome_with({4: 0.6, 5: 0.3, 10: 0.5}).passed


def test_a_requested_test_disturbs_no_sample() -> None:
    with TaxelChip() as board:
        board.chip.analog[0] = np.arange(1, 19) / 20
        board.run(300)
        for _ in range(3):
            board.chip.send(encode_request(SELF_TEST))
            board.run(TEST_FRAMES + 20)
        assert [test.count for test in board.tests] == [1, 2, 3, 4]
        assert np.abs(np.diff(board.sampled(0)) - FRAME_CYCLES).max() <= 2
        assert np.all(np.diff(board.counters) == 1)
        assert not board.flags.any()
        assert np.all(board.samples == board.samples[0])
        assert board.statuses[-1].late_slots == 0


def test_the_outcome_is_sent_with_the_identity_and_is_in_the_status() -> None:
    with TaxelChip() as board:
        board.chip.analog[0] = AT_REST
        board.x.lines_low = 1
        board.run(150)
        board.chip.send(encode_request(IDENTIFY))
        board.run(5)
        assert len(board.tests) == 2 and board.tests[0] == board.tests[1]
        board.x.lines_low = 0
        board.chip.send(encode_request(SELF_TEST))
        board.run(5)
        board.chip.send(encode_request(IDENTIFY))
        board.run(195)
        assert board.tests[-1] == SelfTest(2, ALL)
        bits = [status.self_test_bits for status in board.statuses]
        assert bits[0] == SelfTestBit.DONE | SelfTestBit.FOUND
        assert bits[-1] == SelfTestBit.DONE


def test_the_supply_is_measured_again_after_a_test() -> None:
    with TaxelChip() as board:
        board.chip.analog[0] = AT_REST
        board.run(120)
        assert abs(board.statuses[-1].supply_mv - 5000) < 30
