"""Disturbed frames of the taxel board on the finger board's second line."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from rigctl.finger.bench.firmware import FingerFirmware
from rigctl.finger.decoder import FingerBlock, FingerDecoder
from rigctl.finger.values import N_FINGER_TAXELS
from tests.finger.finger_building import taxel_frame

FRAMES = 400


def received(order: NDArray[np.int64]) -> FingerBlock:
    """Return what the board passes on where frames come in this order; frame i reads i."""
    board = FingerFirmware()
    board.boot(0)
    for number in order.tolist():
        readings = np.full(N_FINGER_TAXELS, number % 1024, np.uint16)
        board.receive_taxels(taxel_frame(number, readings))
    block, _ = FingerDecoder().feed(board.take_sent())
    board.close()
    return block


def check(block: FingerBlock, expected: NDArray[np.int64]) -> None:
    """Check the readings, and that each missing frame has moved the board's counter on."""
    assert np.array_equal(block.readings[:, 0], expected % 1024)
    assert np.array_equal(np.diff(block.counters), np.diff(expected))


@pytest.mark.parametrize("at", [1, 57, 399])
def test_a_repeated_frame_is_refused(at: int) -> None:
    frames = np.arange(FRAMES, dtype=np.int64)
    check(received(np.insert(frames, at, frames[at - 1])), frames)


def test_swapped_frames_cost_the_late_one() -> None:
    frames = np.arange(FRAMES, dtype=np.int64)
    swapped = frames.copy()
    swapped[100], swapped[101] = 101, 100
    check(received(swapped), np.delete(frames, 100))


def test_drops_repeats_and_swaps_across_the_wrap_of_the_counter() -> None:
    rng = np.random.default_rng(7)
    order = np.arange(65_400, 65_400 + FRAMES, dtype=np.int64)
    order = np.delete(order, rng.integers(1, FRAMES, 20))
    for at in rng.integers(1, len(order) - 1, 20).tolist():
        order = np.insert(order, at, order[at - 1])
    for at in rng.integers(1, len(order) - 2, 20).tolist():
        order[[at, at + 1]] = order[[at + 1, at]]
    newest = np.maximum.accumulate(order)
    check(received(order), np.unique(newest))


def test_a_taxel_board_that_started_anew_is_read_on() -> None:
    """The host reads on behind the finger board's next status, as after every long gap."""
    order = np.concatenate([np.arange(5000, 5100), np.arange(3000)]).astype(np.int64)
    readings = received(order).readings[:, 0]
    assert np.array_equal(readings[:100], order[:100] % 1024)
    assert np.array_equal(readings[-1000:], order[-1000:] % 1024)
