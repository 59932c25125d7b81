"""Each fault of the virtual finger does what it says, to this slide or to the next."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from rigctl.bench.simulated_rig import TO_BOARD, TO_HOST
from rigctl.errors import LinkLost, WrongUse
from rigctl.finger import board_messages
from rigctl.finger.bench.virtual import (
    FingerTruthArrays,
    VirtualFinger,
    open_virtual_finger,
)
from rigctl.finger.board_messages import FingerIdentity, FingerStatus
from rigctl.finger.decoder import FingerDecoder
from rigctl.finger.values import VelocityProfile
from tests.finger.bench.host import FingerHost, on_plate

MEDIUM = VelocityProfile.MEDIUM


@pytest.fixture
def host() -> Iterator[FingerHost]:
    rig = open_virtual_finger(seed=6)
    yield FingerHost(rig)
    rig.close()


def _speed(truth: FingerTruthArrays) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    return np.diff(truth.along_mm.astype(np.float64)) * 1000.0


def _planned(slide: int) -> FingerTruthArrays:
    """Return the same slide without a fault."""
    rig = open_virtual_finger(seed=6, first_slide=slide)
    truth = FingerHost(rig).slide("B", MEDIUM)
    rig.close()
    return truth


def _finish(host: FingerHost) -> FingerTruthArrays:
    while host.rig.sliding:
        host.wait(10_000)
    host.wait(100_000)
    return on_plate(host.rig.truth.arrays())


def test_standing_still_stops_the_slide_that_is_under_way(host: FingerHost) -> None:
    host.rig.slide("B", MEDIUM)
    host.until_along(120.0)
    host.rig.faults.stand_still(0.5)
    truth = _finish(host)
    still = np.flatnonzero(np.abs(_speed(truth)) < 1e-3)
    assert 480 <= len(still) <= 520
    assert 120.0 < truth.along_mm[still[0]] < 140.0
    assert (truth.force_g[still] > 100.0).all()
    assert len(truth.slide) == pytest.approx(len(_planned(0).slide) + 600, abs=5)
    assert truth.along_mm[-1] == pytest.approx(_planned(0).along_mm[-1], abs=0.1)


def test_a_fault_without_a_slide_waits_for_the_middle_of_the_next(host: FingerHost) -> None:
    host.rig.faults.stand_still(0.5)
    first, second = host.slide("B", MEDIUM), host.slide("B", MEDIUM)
    still = np.flatnonzero(np.abs(_speed(first)) < 1e-3)
    assert 149.0 < first.along_mm[still[0]] < 165.0
    assert not (np.abs(_speed(second)[200:-200]) < 1e-3).any(), "once only"


def test_a_fault_before_the_touch_waits_for_the_middle(host: FingerHost) -> None:
    host.rig.slide("B", MEDIUM)
    host.wait(50_000)
    host.rig.faults.stand_still(0.3)
    truth = _finish(host)
    still = np.flatnonzero(np.abs(_speed(truth)) < 1e-3)
    assert 149.0 < truth.along_mm[still[len(still) // 2]] < 165.0


def test_a_finger_that_runs_back_goes_on(host: FingerHost) -> None:
    host.rig.slide("B", MEDIUM)
    host.until_along(150.0)
    host.rig.faults.reverse()
    truth = _finish(host)
    back = _speed(truth) < -10.0
    assert 350 < np.count_nonzero(back) < 700
    assert np.ptp(truth.along_mm[:-1][back]) > 20.0
    assert truth.along_mm[-1] > 255.0
    assert np.abs(_speed(truth)).max() < 300.0, "without a jump"


def test_a_lifted_finger_has_no_force_while_the_hand_moves_on(host: FingerHost) -> None:
    host.rig.faults.lift(0.4)
    truth = host.slide("B", MEDIUM)
    lifted = np.flatnonzero(truth.force_g == 0.0)
    assert 280 < len(lifted) < 400
    assert truth.height_mm[lifted].max() > 20.0
    assert _speed(truth)[lifted].min() > 30.0
    assert len(truth.slide) == len(_planned(0).slide)


def test_too_fast_is_600_mm_a_second(host: FingerHost) -> None:
    host.rig.faults.too_fast()
    truth = host.slide("B", MEDIUM)
    fast = _speed(truth)[truth.along_mm[:-1] > 200.0]
    assert 400.0 < fast.max() < 1500.0
    assert len(truth.slide) < 0.75 * len(_planned(0).slide)


def test_a_short_scan_never_reaches_the_second_mark(host: FingerHost) -> None:
    host.rig.slide("B", MEDIUM)
    host.until_along(150.0)
    host.rig.faults.short_scan()
    truth = _finish(host)
    assert 150.0 < truth.along_mm.max() < 175.0
    whole = host.slide("B", MEDIUM)
    assert whole.along_mm.max() > 255.0


def test_another_plate_lies_there_for_one_slide(host: FingerHost) -> None:
    host.rig.faults.wrong_plate("N")
    assert (host.slide("B", MEDIUM).plate == b"N").all()
    assert (host.slide("B", MEDIUM).plate == b"B").all()
    with pytest.raises(WrongUse, match="no plate 'Q'"):
        host.rig.faults.wrong_plate("Q")


def test_a_lost_tracker_says_so_and_its_frame_has_shifted_afterwards(host: FingerHost) -> None:
    host.wait(500_000)
    before = host.positions[-1]
    host.rig.faults.lose_tracker(0.3)
    host.wait(700_000)
    lost_s = [p.at_s for p in host.positions if not p.valid]
    assert len(lost_s) == pytest.approx(30, abs=5)
    assert min(lost_s) > 0.48 and max(lost_s) < 0.83
    moved = np.subtract(host.positions[-1][1:4], before[1:4])
    assert np.linalg.norm(moved) > 1.0


def test_a_board_that_is_plugged_in_again_boots(host: FingerHost) -> None:
    rig = host.rig
    host.wait(300_000)
    rig.faults.unplug()
    assert host.lost == ["finger: the port vanished: plug the board in again"]
    host.wait(200_000)
    with pytest.raises(LinkLost):
        host.open_cable()
    rig.faults.replug()
    host.open_cable()
    host.wait(200_000)
    block, decoded = host.decode()
    assert isinstance(decoded[0], FingerIdentity)
    assert block.counters[0] == 0
    assert len(block.counters) == pytest.approx(200, abs=11)


def test_a_reset_restarts_the_counters(host: FingerHost) -> None:
    host.wait(300_000)
    host.rig.faults.reset()
    host.wait(150_000)
    statuses = [m for m in host.decode()[1] if isinstance(m, FingerStatus)]
    assert [status.samples for status in statuses] == [100, 200, 100]


def test_a_stalled_cable_is_silent_both_ways(host: FingerHost) -> None:
    host.wait(100_000)
    received = len(host.pieces)
    host.rig.faults.stall()
    host.rig.finger.write(board_messages.identify())
    host.wait(200_000)
    assert len(host.pieces) == received
    host.rig.faults.stall(False)
    host.wait(100_000)
    block, decoded = host.decode()
    assert block.missing == pytest.approx(200, abs=11)
    assert sum(isinstance(m, FingerIdentity) for m in decoded) == 1, "that of the boot"


def _damaged(host: FingerHost) -> int:
    decoder = FingerDecoder()
    decoder.feed(b"".join(data for data, _ in host.pieces))
    return decoder.damaged


@pytest.mark.parametrize("fault", ["drop_bytes", "corrupt_bytes"])
def test_a_bad_cable_damages_frames_to_the_host(host: FingerHost, fault: str) -> None:
    getattr(host.rig.faults, fault)(TO_HOST, 0.005)
    host.wait(1_000_000)
    assert 30 < _damaged(host) < 300
    getattr(host.rig.faults, fault)(TO_HOST, 0.0)
    host.pieces.clear()
    host.wait(1_000_000)
    assert _damaged(host) == 0


def test_a_bad_cable_damages_requests_to_the_board(host: FingerHost) -> None:
    host.rig.faults.corrupt_bytes(TO_BOARD, 0.2)
    for _ in range(20):
        host.rig.finger.write(board_messages.read_settings())
        host.wait(10_000)
    host.wait(200_000)
    status = [m for m in host.decode()[1] if isinstance(m, FingerStatus)][-1]
    assert status.damaged_requests > 5


def _readings(rig: VirtualFinger) -> list[int]:
    host = FingerHost(rig)
    host.slide("B", MEDIUM)
    rig.close()
    readings: list[int] = host.decode()[0].readings.ravel().tolist()
    return readings


def test_without_faults_two_fingers_are_equal() -> None:
    one, other = (open_virtual_finger(seed=9) for _ in range(2))
    assert _readings(one) == _readings(other)
