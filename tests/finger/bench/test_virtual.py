"""The virtual finger as a whole: reproducible, exact in its bytes, and timed as stated."""

from __future__ import annotations

import asyncio
import hashlib
from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import NDArray

from rigctl.bench.clock import SimulatedTimeLoop
from rigctl.bench.parameters import WorldParameters
from rigctl.errors import WrongUse
from rigctl.finger import board_messages
from rigctl.finger.bench.boards import ConverterBoard
from rigctl.finger.bench.operator_parameters import OperatorParameters, TrackerParameters
from rigctl.finger.bench.skin import TOP_LAYER
from rigctl.finger.bench.virtual import (
    FLUSH_US,
    KEPT_MS,
    USB_US,
    FingerTruth,
    VirtualFinger,
    open_virtual_finger,
)
from rigctl.finger.board_messages import Answer, BatchReport, FingerIdentity
from rigctl.finger.values import VelocityProfile
from tests.finger.bench.host import FingerHost

FAST = VelocityProfile.FAST


@pytest.fixture
def rig() -> Iterator[VirtualFinger]:
    rig = open_virtual_finger(seed=1)
    yield rig
    rig.close()


def _digest(step_us: int, seed: int = 1, session: int = 0) -> str:
    rig = open_virtual_finger(seed=seed, session=session)
    host = FingerHost(rig)
    rig.slide("B", FAST)
    rig.finger.write(board_messages.start(1))
    while rig.time_us < 1_800_000:
        rig.advance(rig.time_us + step_us)
    rig.close()
    received = b"".join(data for data, _ in host.pieces) + repr(host.positions).encode()
    return hashlib.sha256(received).hexdigest()


@pytest.mark.to_the_bit
def test_the_same_seed_gives_the_same_bytes_and_positions_whatever_the_slices() -> None:
    assert len({_digest(step_us) for step_us in (700, 10_000, 90_000)}) == 1
    assert len({_digest(10_000), _digest(10_000, seed=2), _digest(10_000, session=1)}) == 3


class RecordingBoard(ConverterBoard):
    """Keeps the readings that it was given."""

    def __init__(self) -> None:
        super().__init__()
        self.given: list[NDArray[np.uint16]] = []

    def run(self, readings: NDArray[np.uint16]) -> None:
        self.given.append(readings)
        super().run(readings)


@pytest.mark.to_the_bit
def test_the_bytes_decode_to_the_readings_of_the_skin() -> None:
    board = RecordingBoard()
    parts = WorldParameters(), OperatorParameters(), TrackerParameters()
    rig = VirtualFinger(board, *parts, (1, 0), 0)
    host = FingerHost(rig)
    host.slide("B", FAST)
    rig.close()
    block, _ = host.decode()
    given = np.concatenate(board.given)[:, TOP_LAYER]
    assert np.array_equal(block.readings, given[: len(block.readings)])
    assert len(given) - len(block.readings) <= FLUSH_US // 1000
    assert np.ptp(block.readings.astype(int), axis=0).min() > 100


@pytest.mark.to_the_bit
def test_the_taxel_boards_line_carries_the_same_readings() -> None:
    readings = []
    for taxel_board in (False, True):
        rig = open_virtual_finger(seed=1, taxel_board=taxel_board)
        host = FingerHost(rig)
        host.slide("N", FAST)
        rig.close()
        readings.append(host.decode()[0].readings)
    assert np.array_equal(*readings)


def _slide_readings(rig: VirtualFinger, number: int) -> NDArray[np.int64]:
    """Make slides up to a number, the last after a long rest, and return its readings from touch
    to lift.
    """
    host = FingerHost(rig)
    while rig.next_slide <= number:
        host.wait(20_000_000 if rig.next_slide == number else 0)
        truth = host.slide("D", VelocityProfile.MEDIUM)
    rig.close()
    readings = host.decode()[0].readings[truth.first_ms : truth.first_ms + len(truth.slide)]
    return readings.astype(np.int64)


@pytest.mark.to_the_bit
def test_a_resumed_run_continues_with_the_draws_of_the_next_slide() -> None:
    whole = _slide_readings(open_virtual_finger(seed=4), 2)
    resumed = _slide_readings(open_virtual_finger(seed=4, first_slide=2), 2)
    other = _slide_readings(open_virtual_finger(seed=4, first_slide=3), 3)
    assert np.array_equal(whole, resumed)
    assert len(other) != len(whole)


@pytest.mark.parametrize("seed", [3, 6])
@pytest.mark.to_the_bit
def test_nothing_of_a_slide_is_left_after_a_long_rest(seed: int) -> None:
    """With this skin a reading of these slides moved by a count, on every processor."""
    soft = WorldParameters(top_gain=1.0, relaxation=0.3)
    whole = _slide_readings(open_virtual_finger(soft, seed=seed), 2)
    resumed = _slide_readings(open_virtual_finger(soft, seed=seed, first_slide=2), 2)
    assert np.array_equal(whole, resumed)


def test_a_sample_reaches_the_host_within_a_flush_and_the_cables_time(rig: VirtualFinger) -> None:
    host = FingerHost(rig)
    host.wait(1_000_000)
    arrivals_us = np.array([round(at_s * 1e6) for _, at_s in host.pieces])
    assert (arrivals_us % FLUSH_US == 0).all()
    assert (np.diff(arrivals_us) == FLUSH_US).all()
    counters = host.decode()[0].counters
    assert counters[-1] == (arrivals_us[-1] - USB_US) // 1000 - 1


def test_an_answer_takes_the_cable_twice(rig: VirtualFinger) -> None:
    host = FingerHost(rig)
    host.wait(123_400)
    rig.finger.write(board_messages.identify())
    host.wait(2 * USB_US - 1)
    assert not any(isinstance(m, FingerIdentity) for m in host.decode()[1][1:])
    host.wait(1)
    assert isinstance(host.decode()[1][-1], FingerIdentity)
    assert host.pieces[-1][1] == pytest.approx(0.1244)


def test_a_velocity_brings_its_batch_after_a_millisecond(rig: VirtualFinger) -> None:
    host = FingerHost(rig)
    rig.finger.write(board_messages.start(5))
    host.wait(150_000)
    rig.finger.write(board_messages.velocity(5, 0, 80_000))
    written_us = rig.time_us
    host.wait(2 * USB_US)
    assert [m.batch for m in host.decode()[1] if isinstance(m, BatchReport)] == [0]
    assert host.pieces[-1][1] * 1e6 == pytest.approx(written_us + 2 * USB_US)


def test_the_event_loop_runs_in_the_fingers_time(rig: VirtualFinger) -> None:
    loop = SimulatedTimeLoop(rig)
    times: list[tuple[float, float]] = []
    rig.finger.open(lambda data, at_s: times.append((at_s, loop.time())), print)
    loop.run_until_complete(asyncio.sleep(0.5))
    loop.close()
    assert rig.time_us == 500_000
    assert len(times) == 500_000 // FLUSH_US
    assert all(at_s == pytest.approx(now_s) for at_s, now_s in times)


def test_the_truth_names_plate_and_slide(rig: VirtualFinger) -> None:
    host = FingerHost(rig)
    first, second = host.slide("B", FAST), host.slide("L", FAST)
    assert (first.plate == b"B").all() and (second.plate == b"L").all()
    assert (first.slide == 0).all() and (second.slide == 1).all()
    taken = rig.truth.take()
    assert len(taken.force_g) == taken.first_ms + rig.time_us // 1000 - 1
    assert len(rig.truth.arrays().force_g) == 0
    host.wait(50_000)
    assert rig.truth.arrays().first_ms == len(taken.force_g)


def test_the_truth_that_nobody_takes_does_not_grow_for_ever() -> None:
    truth = FingerTruth()
    for _ in range(0, 2 * KEPT_MS, 10_000):
        truth.append(np.zeros((10_000, 4)))
    arrays = truth.arrays()
    assert len(arrays.force_g) == KEPT_MS
    assert arrays.first_ms == KEPT_MS


def test_two_slides_at_once_and_unknown_plates_are_refused(rig: VirtualFinger) -> None:
    with pytest.raises(WrongUse, match="no plate 'Z'"):
        rig.slide("Z", FAST)
    assert not rig.sliding and rig.next_slide == 0
    rig.slide("A", FAST)
    with pytest.raises(WrongUse, match="wait until the finger is lifted"):
        rig.slide("A", FAST)


def test_a_slide_may_be_asked_for_while_the_hand_returns(rig: VirtualFinger) -> None:
    host = FingerHost(rig)
    rig.slide("A", FAST)
    while rig.sliding:
        host.wait(10_000)
    second = host.slide("A", FAST)
    assert (second.slide == 1).all()
    assert second.along_mm[0] < 50.0


def test_a_closed_finger_only_passes_time(rig: VirtualFinger) -> None:
    rig.close()
    rig.advance(1_000_000)
    assert rig.time_us == 1_000_000


def test_settings_are_answered_over_the_cable(rig: VirtualFinger) -> None:
    host = FingerHost(rig)
    rig.finger.write(board_messages.set_ranges((10,) * 9, (300,) * 9))
    host.wait(2_000)
    assert any(isinstance(message, Answer) for message in host.decode()[1])
