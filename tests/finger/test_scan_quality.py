"""The reasons against a scan, by its data."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rigctl.engine.event_bus import EventBus
from rigctl.finger.board_messages import BatchReport, VelocitySource, WindowReport
from rigctl.finger.latency import LatencyLog
from rigctl.finger.plan import ScanQuality
from rigctl.finger.scan_in_progress import ScanData, SentVelocity
from rigctl.finger.scan_quality import judge_scan, measure_scan
from rigctl.finger.scan_recording import ScanOutput
from rigctl.finger.slide_detector import ContactMeter, contact_share
from rigctl.finger.trackers.velocity import BatchVelocity, EstimateSource
from rigctl.finger.values import FingerTrial, LatencyRow, Stage, VelocityProfile

SLOW_UM_S, MEDIUM_UM_S, FAST_UM_S = 50_000, 100_000, 200_000
NO_SPIKES = (0,) * 9
MEASURED = BatchVelocity(100.0, MEDIUM_UM_S, EstimateSource.MEASURED, 0, 0, 12)


def scan_at(*velocities_um_s: int) -> ScanData:
    """Return a whole scan of 200 mm whose equal parts of the way had these velocities."""
    data = ScanData(first_counter=0)
    for um_s in velocities_um_s:
        batches = round(200_000_000 / len(velocities_um_s) / um_s / 100)
        for _ in range(batches):
            number = len(data.batches)
            report = BatchReport(1, number, um_s, VelocitySource.RECEIVED, 100, 0, 0)
            data.batches.append((report, 0.0))
            data.sent[number] = SentVelocity(number, MEASURED, 0.0)
    data.count = 100 * len(data.batches)
    windows = 20
    for number in range(windows):
        real_ms = data.count // windows
        data.windows.append(WindowReport(1, number, real_ms, NO_SPIKES))
    return data


def reasons(
    data: ScanData,
    profile: VelocityProfile = VelocityProfile.MEDIUM,
    gap_ms: float = 10.0,
    contact: float = 1.0,
) -> tuple[str, ...]:
    trial = FingerTrial(1, Stage.TRAIN, "D", profile, 1)
    times_s = [0.0, 0.01, 0.01 + gap_ms / 1000]
    return judge_scan(trial, data, measure_scan(data, times_s, contact), ScanQuality())


@pytest.mark.parametrize(
    ("velocities", "profile"),
    [
        ((SLOW_UM_S,), VelocityProfile.SLOW),
        ((MEDIUM_UM_S,), VelocityProfile.MEDIUM),
        ((FAST_UM_S,), VelocityProfile.FAST),
        ((SLOW_UM_S, FAST_UM_S), VelocityProfile.SLOW_TO_FAST),
        ((FAST_UM_S, SLOW_UM_S), VelocityProfile.FAST_TO_SLOW),
    ],
)
def test_a_scan_has_one_profile(velocities: tuple[int, ...], profile: VelocityProfile) -> None:
    data = scan_at(*velocities)
    assert reasons(data, profile) == ()
    for other in set(VelocityProfile) - {profile}:
        (reason,) = reasons(data, other)
        assert reason.startswith(f"the velocity profile was {profile.value} (")


def drop_batch(data: ScanData) -> None:
    del data.batches[7]


def drop_window(data: ScanData) -> None:
    del data.windows[7]


def drop_last_window(data: ScanData) -> None:
    del data.windows[-1]


def lose_sample(data: ScanData) -> None:
    data.lost_samples = 1


def hold_velocity(data: ScanData) -> None:
    report, arrived_s = data.batches[3]
    data.batches[3] = replace(report, source=VelocitySource.HELD), arrived_s


def guess_velocity(data: ScanData) -> None:
    held = MEASURED._replace(source=EstimateSource.HELD)
    data.sent[3] = replace(data.sent[3], estimate=held)


@pytest.mark.parametrize(
    ("spoil", "reason"),
    [
        (drop_batch, "reports of the board were lost on its line"),
        (drop_window, "reports of the board were lost on its line"),
        (drop_last_window, "reports of the board were lost on its line"),
        (lose_sample, "lost samples: 1"),
        (hold_velocity, "velocities that did not reach the board in time: 1"),
        (guess_velocity, "batches without a velocity of the tracker: 1"),
    ],
)
def test_incomplete_data_are_refused(spoil: Callable[[ScanData], None], reason: str) -> None:
    data = scan_at(MEDIUM_UM_S)
    spoil(data)
    assert reasons(data) == (reason,)


def test_a_gap_in_the_track_is_refused_from_the_limit_on() -> None:
    assert reasons(scan_at(MEDIUM_UM_S), gap_ms=99.0) == ()
    assert reasons(scan_at(MEDIUM_UM_S), gap_ms=120.0) == ("the tracker was lost for 120 ms",)


def test_a_finger_in_the_air_is_refused() -> None:
    found = reasons(scan_at(MEDIUM_UM_S), contact=0.5)
    assert found == ("the finger touched the plate in 50 % of the scan",)


@pytest.mark.parametrize("um_s", [10_000, 500_000])
def test_a_speed_outside_the_limits_is_refused(um_s: int) -> None:
    (reason,) = reasons(scan_at(um_s))
    assert reason == f"the mean speed is {um_s // 1000} mm/s, outside 15 to 400 mm/s"


def test_a_bad_reading_and_a_drift_do_not_become_rest_for_good() -> None:
    meter = ContactMeter()
    rest = np.full((1000, 9), 100, np.uint16)
    meter.add(np.zeros((10, 9), np.uint16))
    for _ in range(40):
        meter.add(rest)
    assert not meter.touches, "the reading of a moment without a sensor is left out"
    for _ in range(200):
        meter.add(rest + np.uint16(60))
    assert not meter.touches, "rest has risen"


def test_contact_is_a_rise_over_rest() -> None:
    meter = ContactMeter()
    rest = np.full((50, 9), 100, np.uint16)
    meter.add(rest)
    assert not meter.touches
    assert not meter.pressed.any()
    meter.add(rest + np.uint16(25))
    assert meter.touches
    assert meter.pressed.all()
    meter.add(rest[:0])
    meter.add(rest)
    assert meter.touches, "the ridges of a plate may be between the taxels"
    meter.add(rest)
    assert not meter.touches


@pytest.mark.parametrize(
    ("gaps", "share"),
    [((50,), 1.0), ((50, 50), 1.0), ((51,), 0.949), ((200,), 0.8), ((1000,), 0.0)],
)
def test_a_contact_lasts_between_two_ridges(gaps: tuple[int, ...], share: float) -> None:
    pressed = np.ones(1000, np.bool_)
    begin = 0
    for gap in gaps:
        pressed[begin : begin + gap] = False
        begin += gap + 100
    assert contact_share(pressed) == pytest.approx(share)


class _Recorder:
    """Keeps the latencies, and takes everything else."""

    def __init__(self) -> None:
        self.latencies_ms: list[float] = []

    def add_row(self, row: Any) -> None:
        if isinstance(row, LatencyRow):
            self.latencies_ms.append(row.ms)


@pytest.mark.parametrize(
    ("source", "sent_s", "latencies_ms"),
    [
        (VelocitySource.RECEIVED, 9.998, [2.0]),
        (VelocitySource.HELD, 10.001, []),
        (VelocitySource.MISSING, 10.001, []),
    ],
)
def test_features_of_a_velocity_that_came_too_late_have_no_latency(
    source: VelocitySource, sent_s: float, latencies_ms: list[float]
) -> None:
    """The board did not wait: its report was on the way when the velocity was sent."""
    recorder: Any = _Recorder()
    output = ScanOutput(recorder, EventBus(lambda: 10.0, print), LatencyLog(), lambda: 10.0)
    estimate = BatchVelocity(100.0, 100_000, EstimateSource.MEASURED, 0, 0, 10)
    data = ScanData(sent={0: SentVelocity(0, estimate, sent_s)})
    scan: Any = SimpleNamespace(number=1, data=data)
    output.add_window(WindowReport(1, 0, 100, (0,) * 9), 10.0)
    output.add_batch(scan, BatchReport(1, 0, 100_000, source, 100, 0, 0), 10.0)
    assert recorder.latencies_ms == pytest.approx(latencies_ms)
