"""Measures of a finished scan, and the reasons against it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.finger.board_messages import VelocitySource
from rigctl.finger.plan import ScanQuality
from rigctl.finger.scan_in_progress import ScanData
from rigctl.finger.trackers.velocity import MISSED_S, EstimateSource
from rigctl.finger.values import MARKS_MM, FingerTrial, VelocityProfile

Floats = NDArray[np.float64]

SCAN_MM = MARKS_MM[1] - MARKS_MM[0]
MAX_DISTANCE_ERROR_MM = 12.0
"""The way by the velocities may differ this much from the way between the marks."""


@dataclass(frozen=True, slots=True)
class ScanMeasures:
    """What a scan was like.

    Speeds are over the scan and over the halves of its way, by the velocities that the board used.
    ``tracker_gap_ms``: the longest time without a valid position.
    """

    distance_mm: float = 0.0
    mean_mm_s: float = 0.0
    first_half_mm_s: float = 0.0
    second_half_mm_s: float = 0.0
    tracker_lost_s: float = 0.0
    tracker_gap_ms: float = 0.0
    contact_share: float = 0.0


def measure_scan(
    data: ScanData, position_times_s: Sequence[float], contact_share: float
) -> ScanMeasures:
    """Return the measures of a scan.

    ``position_times_s``: loop times of the valid positions during it.
    """
    reports = [report for report, _ in data.batches]
    samples = np.array([report.samples for report in reports], np.float64)
    steps_mm = samples * np.array([report.velocity_um_per_s for report in reports]) / 1e6
    distance_mm, seconds = float(steps_mm.sum()), float(samples.sum()) / 1000.0
    gaps_s = np.diff(np.array(position_times_s))
    first, second = _half_speeds(steps_mm, samples / 1000.0)
    return ScanMeasures(
        distance_mm,
        distance_mm / seconds if seconds else 0.0,
        first,
        second,
        float(gaps_s[gaps_s > MISSED_S].sum()) if len(gaps_s) else 0.0,
        float(gaps_s.max() * 1000.0) if len(gaps_s) else 0.0,
        contact_share,
    )


def judge_scan(
    trial: FingerTrial, data: ScanData, measures: ScanMeasures, quality: ScanQuality
) -> tuple[str, ...]:
    """Return the reasons against a scan that reached its end, none if it is good."""
    return (*_data_reasons(data, measures, quality), *_speed_reasons(trial, measures, quality))


def _half_speeds(steps_mm: Floats, seconds: Floats) -> tuple[float, float]:
    """Return the mean speeds over the first and the second half of the way, mm/s."""
    total_mm, total_s = float(steps_mm.sum()), float(seconds.sum())
    if total_mm <= 0.0:
        return 0.0, 0.0
    ways = np.concatenate([[0.0], np.cumsum(steps_mm)])
    times = np.concatenate([[0.0], np.cumsum(seconds)])
    half_s = float(np.interp(total_mm / 2, ways, times))
    first, second = (
        total_mm / 2 / part if part > 0 else 0.0 for part in (half_s, total_s - half_s)
    )
    return first, second


def _data_reasons(data: ScanData, measures: ScanMeasures, quality: ScanQuality) -> Iterator[str]:
    held = sum(report.source is not VelocitySource.RECEIVED for report, _ in data.batches)
    guessed = sum(sent.estimate.source is EstimateSource.HELD for sent in data.sent.values())
    if data.lost_samples > quality.max_lost_samples:
        yield f"lost samples: {data.lost_samples}"
    if not _reports_are_whole(data):
        yield "reports of the board were lost on its line"
    if held > quality.max_held_velocities:
        yield f"velocities that did not reach the board in time: {held}"
    if measures.tracker_gap_ms > quality.max_tracker_gap_ms:
        yield f"the tracker was lost for {measures.tracker_gap_ms:.0f} ms"
    elif guessed > quality.max_held_velocities:
        yield f"batches without a velocity of the tracker: {guessed}"
    if 100.0 * measures.contact_share < quality.min_contact_percent:
        yield f"the finger touched the plate in {100 * measures.contact_share:.0f} % of the scan"
    if abs(measures.distance_mm - SCAN_MM) > MAX_DISTANCE_ERROR_MM:
        yield f"the scan covers {measures.distance_mm:.0f} mm instead of {SCAN_MM:.0f} mm"


def _reports_are_whole(data: ScanData) -> bool:
    """Return whether the reports of all batches and windows have come, in their order."""
    batches = [report for report, _ in data.batches]
    samples = sum(report.samples for report in batches)
    return (
        [report.batch for report in batches] == list(range(len(batches)))
        and [report.window for report in data.windows] == list(range(len(data.windows)))
        and data.count <= samples == sum(report.real_ms for report in data.windows)
    )


def _speed_reasons(
    trial: FingerTrial, measures: ScanMeasures, quality: ScanQuality
) -> Iterator[str]:
    mean, slow, fast = measures.mean_mm_s, quality.slow_max_mm_s, quality.fast_min_mm_s
    halves = measures.first_half_mm_s, measures.second_half_mm_s
    if not quality.slowest_mm_s <= mean <= quality.fastest_mm_s:
        limits = f"{quality.slowest_mm_s:g} to {quality.fastest_mm_s:g} mm/s"
        yield f"the mean speed is {mean:.0f} mm/s, outside {limits}"
        return
    made = _profile(mean, *halves, quality)
    if made is not trial.profile:
        yield (
            f"the velocity profile was {made.value} ({halves[0]:.0f} then {halves[1]:.0f} mm/s; "
            f"slow is below {slow:g}, fast above {fast:g}), not {trial.profile.value}"
        )


def _profile(
    mean_mm_s: float, first_mm_s: float, second_mm_s: float, quality: ScanQuality
) -> VelocityProfile:
    """Return the profile that a scan had."""
    if second_mm_s > quality.change_ratio * first_mm_s:
        return VelocityProfile.SLOW_TO_FAST
    if first_mm_s > quality.change_ratio * second_mm_s:
        return VelocityProfile.FAST_TO_SLOW
    if mean_mm_s < quality.slow_max_mm_s:
        return VelocityProfile.SLOW
    return VelocityProfile.FAST if mean_mm_s > quality.fast_min_mm_s else VelocityProfile.MEDIUM
