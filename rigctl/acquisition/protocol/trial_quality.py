"""Quality of a trial attempt, judged from its own data, with each reason as a sentence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rigctl.acquisition.taxels.trial_cutter import CutTrial
from rigctl.protocol import Quality
from rigctl.values import SAMPLE_RATE_HZ, LoadcellSample, PlannedTrial


@dataclass(frozen=True, slots=True)
class QualityLimits:
    """Allowed deviations of a trial; shares of the set-point.

    A force may be off by ``min_force_tolerance_g`` in any case: no load cell reads better.
    """

    speed_share: float
    force_share: float
    lost_samples: int
    force_spread_share: float = 0.15
    min_force_tolerance_g: float = 4.0
    late_share: float = 0.01

    @classmethod
    def of(cls, quality: Quality) -> QualityLimits:
        """Return the limits that a protocol sets."""
        speed, force = quality.speed_tolerance_percent, quality.force_tolerance_percent
        return cls(speed / 100, force / 100, quality.max_lost_samples)


@dataclass(frozen=True, slots=True)
class TrialWindow:
    """The trial's window as the drum measured it.

    ``travel_mm`` of texture passed between the sync line's rise at ``rise_us`` and its fall at
    ``fall_us``, unwrapped board time; the board's clock runs ``clock_ppm`` fast. ``loadcell``:
    samples of the attempt, some of them before or behind the window.
    """

    travel_mm: float
    rise_us: int
    fall_us: int
    clock_ppm: float
    loadcell: Sequence[LoadcellSample]


@dataclass(frozen=True, slots=True)
class MeasuredTrial:
    """Measured speed, force and length of the window; NaN where not measured."""

    mean_speed_mm_s: float = float("nan")
    mean_force_g: float = float("nan")
    force_spread_g: float = float("nan")
    window_s: float = float("nan")


def measure(planned: PlannedTrial, window: TrialWindow) -> MeasuredTrial:
    """Return the mean speed over the window and the force over the samples of the trial."""
    board_s = (window.fall_us - window.rise_us) / 1e6
    if board_s <= 0:
        return MeasuredTrial()
    true_s = board_s / (1.0 + window.clock_ppm * 1e-6)
    end_us = window.rise_us + planned.n_samples * 1_000_000 // SAMPLE_RATE_HZ
    inside = [s.force_g for s in window.loadcell if window.rise_us <= s.board_time_us <= end_us]
    if not inside:
        return MeasuredTrial(window.travel_mm / true_s, window_s=true_s)
    force_g, spread_g = float(np.mean(inside)), float(np.std(inside))
    return MeasuredTrial(window.travel_mm / true_s, force_g, spread_g, true_s)


def judge(
    planned: PlannedTrial, cut: CutTrial | None, measured: MeasuredTrial, limits: QualityLimits
) -> tuple[str, ...]:
    """Return the reasons to repeat the trial, none where it is good."""
    if cut is None:
        return ("the sync line never rose in the taxel samples: check its wire",)
    return (
        *_data_reasons(cut, limits),
        *_window_reasons(cut, measured),
        *_motion_reasons(planned, measured, limits),
    )


def _data_reasons(cut: CutTrial, limits: QualityLimits) -> list[str]:
    reasons = []
    if cut.start_lost:
        reasons.append("the samples around the sync line's rise were lost")
    if cut.n_samples - cut.received > limits.lost_samples:
        reasons.append(f"{cut.n_samples - cut.received} of {cut.n_samples} samples are missing")
    if cut.overrun:
        reasons.append(f"{cut.overrun} samples were overrun on the taxel board")
    if cut.late > limits.late_share * cut.n_samples:
        reasons.append(f"{cut.late} samples were taken late")
    if cut.sync_low:
        reasons.append(f"the sync line was low for {cut.sync_low} samples of the trial")
    return reasons


def _window_reasons(cut: CutTrial, measured: MeasuredTrial) -> list[str]:
    """Without the sync line's level in each sample, the drum's window must be long enough."""
    window_samples = measured.window_s * SAMPLE_RATE_HZ
    if cut.by_wire or window_samples >= cut.n_samples:
        return []
    return [f"the drum's window lasted {window_samples:.0f} samples, {cut.n_samples} are needed"]


def _motion_reasons(
    planned: PlannedTrial, measured: MeasuredTrial, limits: QualityLimits
) -> list[str]:
    reasons = []
    speed_limit = limits.speed_share * planned.speed_mm_s
    if not _is_close(measured.mean_speed_mm_s, planned.speed_mm_s, speed_limit):
        reasons.append(
            f"mean speed {measured.mean_speed_mm_s:.2f} mm/s instead of {planned.speed_mm_s:g}"
        )
    if planned.force_mode != "hold" or planned.force_g <= 0:
        return reasons
    force_limit = max(limits.force_share * planned.force_g, limits.min_force_tolerance_g)
    if not _is_close(measured.mean_force_g, planned.force_g, force_limit):
        reasons.append(f"mean force {measured.mean_force_g:.1f} g instead of {planned.force_g:g}")
    spread_limit = max(
        limits.force_spread_share * planned.force_g, 2 * limits.min_force_tolerance_g
    )
    if measured.force_spread_g > spread_limit:
        reasons.append(
            f"force spread {measured.force_spread_g:.1f} g, at most {spread_limit:.1f} g"
        )
    return reasons


def _is_close(value: float, planned: float, limit: float) -> bool:
    """Return whether a value is within its limit; False for NaN: it was not measured."""
    return abs(value - planned) <= limit
