"""The simulated tracker: rate, noise, latency, gaps, frame, and the wrist that it measures."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from rigctl.errors import LinkLost
from rigctl.finger.bench.operator_parameters import OperatorParameters, TrackerParameters
from rigctl.finger.bench.virtual import VirtualFinger, open_virtual_finger
from rigctl.finger.values import PLATE_CORNERS_MM, VelocityProfile
from rigctl.values import Position
from tests.finger.bench.host import FingerHost, on_plate

P = TrackerParameters()
EXACT = dataclasses.replace(
    P, noise_mm=0.0, latency_error_ms=0.0, arrival_jitter_ms=0.0, dropouts_per_min=0.0
)
STEADY = dataclasses.replace(
    OperatorParameters(),
    wrist_session_mm=0.0,
    wrist_scan_mm=0.0,
    wrist_bend_mm=0.0,
    wrist_wander_mm=0.0,
    corner_touch_mm=0.0,
)


def _at_rest(tracker: TrackerParameters, seconds: float, session: int = 0) -> list[Position]:
    rig = open_virtual_finger(seed=1, session=session, tracker=tracker)
    host = FingerHost(rig)
    rig.advance(round(1e6 * seconds))
    rig.close()
    return host.positions


def _on_plate_mm(rig: VirtualFinger, positions: list[Position]) -> NDArray[np.float64]:
    """Return positions on the plate by the touched corners, float64 (n, 3)."""
    touched = rig.touch_corners()
    points = np.array([point for _, point in touched])
    places = np.array([(*PLATE_CORNERS_MM[name], 0.0) for name, _ in touched])
    turn, _ = Rotation.align_vectors(places - places.mean(axis=0), points - points.mean(axis=0))
    measured = np.array([(p.x_mm, p.y_mm, p.z_mm) for p in positions])
    found: NDArray[np.float64] = turn.apply(measured - points.mean(axis=0)) + places.mean(axis=0)
    return found


def test_rate_noise_and_jitter_at_rest() -> None:
    whole = dataclasses.replace(P, dropouts_per_min=0.0)
    positions = _at_rest(whole, 20.0)
    at_s = np.array([p.at_s for p in positions])
    places = np.array([(p.x_mm, p.y_mm, p.z_mm) for p in positions])
    assert len(positions) == pytest.approx(20.0 * P.rate_hz, rel=0.01)
    assert np.std(places, axis=0) == pytest.approx(np.full(3, P.noise_mm), rel=0.1)
    assert (np.diff(at_s) > 0.0).all()
    assert np.std(np.diff(at_s)) * 1000 == pytest.approx(np.sqrt(2) * P.arrival_jitter_ms, rel=0.2)
    assert all(p.valid for p in positions)


def test_gaps_have_their_rate_and_length() -> None:
    often = dataclasses.replace(P, dropouts_per_min=60.0, arrival_jitter_ms=0.0)
    steps_ms = np.diff([p.at_s for p in _at_rest(often, 60.0)]) * 1000.0
    gaps_ms = steps_ms[steps_ms > 15.0]
    assert len(gaps_ms) == pytest.approx(60, abs=20)
    assert np.mean(gaps_ms) == pytest.approx(P.dropout_ms + 10.0, rel=0.4)


def test_the_stated_time_is_wrong_by_the_sessions_unknown_latency_only() -> None:
    errors_ms = []
    for session in range(12):
        tracker = dataclasses.replace(EXACT, latency_error_ms=P.latency_error_ms)
        rig = open_virtual_finger(operator=STEADY, seed=1, session=session, tracker=tracker)
        host = FingerHost(rig)
        host.slide("A", VelocityProfile.FAST)
        truth = on_plate(rig.truth.arrays())
        along_mm = _on_plate_mm(rig, host.positions)[:, 0]
        at_s = np.array([p.at_s for p in host.positions])
        inside = (along_mm > 80.0) & (along_mm < 220.0) & (at_s > truth.first_ms * 1e-3)
        inside &= at_s < (truth.first_ms + len(truth.along_mm)) * 1e-3
        true_s = (
            truth.first_ms + 1 + np.interp(along_mm, truth.along_mm, np.arange(len(truth.along_mm)))
        ) * 1e-3
        delay_ms = 1000.0 * (at_s - true_s)[inside]
        assert np.std(delay_ms) < 0.3
        errors_ms.append(np.mean(delay_ms))
        rig.close()
    assert 1.0 < np.std(errors_ms) < 6.0


def test_a_steady_wrist_and_touched_corners_give_the_fingers_place() -> None:
    rig = open_virtual_finger(operator=STEADY, seed=2, tracker=EXACT)
    host = FingerHost(rig)
    host.slide("B", VelocityProfile.SLOW)
    found = _on_plate_mm(rig, host.positions)
    truth = rig.truth.arrays()
    rows = np.array([round(p.at_s * 1000) - 1 for p in host.positions])
    rig.close()
    true = np.stack([truth.along_mm, truth.across_mm, truth.height_mm], axis=1)[rows[5:]]
    assert np.abs(found[5:] - true).max() < 0.5


def _begins_mm(profile: VelocityProfile) -> list[float]:
    """Return where the finger truly is when the tracker has it at the first mark."""
    begins = []
    for session in range(3):
        rig = open_virtual_finger(seed=3, session=session)
        host = FingerHost(rig)
        for _ in range(4):
            host.positions.clear()
            host.slide("A", profile)
            found = _on_plate_mm(rig, host.positions)
            low = int(np.argmax((found[:, 0] > 50.0) & (found[:, 2] < 15.0)))
            truth = rig.truth.arrays()
            begins.append(float(truth.along_mm[round(host.positions[low].at_s * 1000)]))
        rig.close()
    return begins


def test_a_scan_begins_some_millimetres_from_the_mark() -> None:
    begins = _begins_mm(VelocityProfile.MEDIUM)
    assert 1.0 < np.std(begins) < 8.0
    assert abs(np.mean(begins) - 50.0) < 6.0


def test_touched_corners_have_the_plates_shape_within_their_error() -> None:
    rig = open_virtual_finger(seed=5)
    touched = dict(rig.touch_corners())
    assert list(touched) == list(PLATE_CORNERS_MM)
    assert rig.touch_corners() == list(touched.items()), "the same for a session"
    length = np.linalg.norm(np.subtract(touched["end left"], touched["start left"]))
    width = np.linalg.norm(np.subtract(touched["start right"], touched["start left"]))
    assert length == pytest.approx(300.0, abs=2.5)
    assert width == pytest.approx(36.0, abs=2.5)
    rig.close()


def test_a_tracker_has_one_user_and_can_be_switched_off() -> None:
    rig = open_virtual_finger()
    host = FingerHost(rig)
    with pytest.raises(LinkLost, match="already in use"):
        rig.tracker.open(print, print)
    rig.faults.unplug_tracker()
    assert host.lost == ["simulated tracker: it sends nothing more: switch the tracker on"]
    with pytest.raises(LinkLost, match="switch the tracker on"):
        rig.tracker.open(host.positions.append, print)
    rig.faults.replug_tracker()
    rig.tracker.open(host.positions.append, print)
    rig.advance(200_000)
    assert len(host.positions) > 10
    rig.close()
