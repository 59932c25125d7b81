"""The quality of a trial: what was measured in its window, and why it is rejected.

The limits of a protocol are `Quality` of `rigctl.protocol.plan`; the firmware's own fault for a
force that swings is FORCE_UNSTEADY.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.config.rig_config import TaxelArray
from rigctl.engine.trial_cutter import CutTrial
from rigctl.protocol.plan import Quality
from rigctl.values import SAMPLE_RATE_HZ, DrumState, LoadcellSample, PlannedTrial, TrialRow, Verdict

MIN_FORCE_TOLERANCE_G = 4.0
"""Smallest tolerance of a force, because no load cell measures more accurately."""
MAX_FORCE_SPREAD_SHARE = 0.15
MAX_LATE_SHARE = 0.01


@dataclass(frozen=True, slots=True)
class MeasuredTrial:
    """Measured speed, force and length of the window; NaN where not measured.

    ``forces_g``: the load cell's readings in the window, float64 (n,).
    """

    mean_speed_mm_s: float = float("nan")
    mean_force_g: float = float("nan")
    force_spread_g: float = float("nan")
    window_s: float = float("nan")
    forces_g: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))


def measure(
    planned: PlannedTrial,
    poll: DrumState,
    loadcell: Sequence[LoadcellSample],
    travel_mm: float,
    clock_ppm: float,
) -> MeasuredTrial:
    """Return the mean speed over the window and the force over the samples of the trial.

    ``poll``: one after the window, with the times of its sync edges. ``loadcell``: samples of the
    attempt, some of them before or after the window. ``travel_mm`` of texture passed in the window.
    The drum's clock runs ``clock_ppm`` fast.
    """
    rise_us = poll.sync_rise_us
    board_s = (poll.sync_fall_us - rise_us) / 1e6
    if board_s <= 0:
        return MeasuredTrial()
    true_s = board_s / (1.0 + clock_ppm * 1e-6)
    end_us = rise_us + planned.n_samples * 1_000_000 // SAMPLE_RATE_HZ
    inside = np.array([s.force_g for s in loadcell if rise_us <= s.board_time_us <= end_us])
    if not inside.size:
        return MeasuredTrial(travel_mm / true_s, window_s=true_s)
    force_g, spread_g = float(np.mean(inside)), float(np.std(inside))
    return MeasuredTrial(travel_mm / true_s, force_g, spread_g, true_s, inside)


def judge(
    planned: PlannedTrial, cut: CutTrial | None, measured: MeasuredTrial, quality: Quality
) -> tuple[str, ...]:
    """Return the reasons to repeat the trial, none where it is good."""
    if cut is None:
        return ("the sync line never rose in the taxel samples: check its wire",)
    return (
        *_data_reasons(cut, quality),
        *_window_reasons(cut, measured),
        *_speed_reasons(planned, measured, quality),
        *_force_reasons(planned, measured, quality),
    )


def _data_reasons(cut: CutTrial, quality: Quality) -> list[str]:
    reasons = []
    if cut.start_lost:
        reasons.append("samples around the sync line's rise were lost")
    if cut.n_samples - cut.received > quality.max_lost_samples:
        reasons.append(f"{cut.n_samples - cut.received} of {cut.n_samples} samples are missing")
    if cut.longest_gap > quality.max_gap_samples:
        reasons.append(f"{cut.longest_gap} samples in a row are missing")
    if cut.overrun:
        reasons.append(f"{cut.overrun} samples were overrun on the taxel board")
    if cut.late > MAX_LATE_SHARE * cut.n_samples:
        reasons.append(f"{cut.late} samples were taken late")
    if cut.sync_low:
        reasons.append(f"the sync line was low for {cut.sync_low} samples of the trial")
    return reasons


def _window_reasons(cut: CutTrial, measured: MeasuredTrial) -> list[str]:
    """Return a reason where the drum's window is too short and the sync line does not show it."""
    window_samples = measured.window_s * SAMPLE_RATE_HZ
    if cut.by_wire or window_samples >= cut.n_samples:
        return []
    return [f"the drum's window lasted {window_samples:.0f} samples, {cut.n_samples} are needed"]


def _speed_reasons(planned: PlannedTrial, measured: MeasuredTrial, quality: Quality) -> list[str]:
    speed_mm_s, planned_mm_s = measured.mean_speed_mm_s, planned.speed_mm_s
    if _is_close(speed_mm_s, planned_mm_s, quality.speed_tolerance_percent / 100 * planned_mm_s):
        return []
    return [f"mean speed {speed_mm_s:.2f} mm/s instead of {planned_mm_s:g}"]


def _force_reasons(planned: PlannedTrial, measured: MeasuredTrial, quality: Quality) -> list[str]:
    planned_g = planned.force_g
    if planned.force_mode != "hold" or planned_g <= 0:
        return []
    reasons = []
    limit_g = max(quality.force_tolerance_percent / 100 * planned_g, MIN_FORCE_TOLERANCE_G)
    if not _is_close(measured.mean_force_g, planned_g, limit_g):
        reasons.append(f"mean force {measured.mean_force_g:.1f} g instead of {planned_g:g}")
    spread_limit_g = max(MAX_FORCE_SPREAD_SHARE * planned_g, 2 * MIN_FORCE_TOLERANCE_G)
    if measured.force_spread_g > spread_limit_g:
        spread = f"{measured.force_spread_g:.1f} g, at most {spread_limit_g:.1f} g"
        reasons.append(f"force spread {spread}")
    return reasons


def trial_row(
    trial: PlannedTrial,
    attempt: int,
    verdict: Verdict,
    reasons: tuple[str, ...],
    cut: CutTrial | None,
    measured: MeasuredTrial,
    started_s: float,
    ended_s: float,
) -> TrialRow:
    """Return the row of an attempt; the recorder fills in part and first sample."""
    return TrialRow(
        trial=trial,
        attempt=attempt,
        part=0,
        first_counter=cut.first_counter if cut else -1,
        first_sample=-1,
        count=cut.n_samples if cut else 0,
        verdict=verdict,
        reasons=reasons,
        started_s=started_s,
        ended_s=ended_s,
        mean_speed_mm_s=measured.mean_speed_mm_s,
        mean_force_g=measured.mean_force_g,
    )


def _is_close(value: float, planned: float, limit: float) -> bool:
    """Return whether a value is within its limit; False for NaN: it was not measured."""
    return abs(value - planned) <= limit


class FailedAttempt(NamedTuple):
    """An attempt that was rejected or put into quarantine.

    ``broken``: the taxels that its reasons are about, from 0.
    """

    trial_id: int
    reasons: tuple[str, ...]
    broken: tuple[int, ...]


def diagnose(failures: Sequence[FailedAttempt], taxels: TaxelArray) -> str:
    """Return what attempts that failed in a row have in common, and where to look."""
    broken = Counter(taxel for one in failures for taxel in one.broken)
    often = sorted(taxel for taxel, n in broken.items() if n > len(failures) / 2)
    since = f"{len(failures)} attempts in a row were not good since trial {failures[0].trial_id}"
    if not often:
        return f"{since}, the last one because {'; '.join(failures[-1].reasons)}"
    places = [divmod(taxels.order[taxel], taxels.inputs) for taxel in often]
    lines = sorted({line + 1 for line, _ in places})
    inputs = sorted({f"A{number}" for _, number in places})
    look = f"line {_listed(lines)} and input {_listed(inputs)}"
    why = "; ".join(dict.fromkeys(failures[-1].reasons))
    return f"{since}: {why}. Look at the wires of {look}"


def _listed(items: Sequence[object]) -> str:
    return ", ".join(map(str, items))
