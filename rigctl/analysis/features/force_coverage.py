"""Which trials of a set have a C: those of a texture and speed with the reference force."""

from __future__ import annotations

from collections.abc import Sequence

from rigctl.analysis.data.trial_set import TrialSet
from rigctl.encoding.force_matrix import ForceMatrix

MOST_LEFT_OUT = 0.5
"""Force is not scaled where more than this share of the trials has no C."""
MAX_LISTED = 5


def force_scaling_obstacle(trials: TrialSet, reference_g: float) -> str:
    """Return a sentence where force cannot be scaled, "" where it can."""
    start = "Force Scaled representations are left out: "
    if len(trials.forces_g) < 2:
        return f"{start}there is only one level of force"
    if reference_g not in trials.forces_g:
        return (
            f"{start}no trial was made at the reference force of {reference_g:g} g "
            "(--reference-force names another)"
        )
    n, lacking = len(trials.trials), trials_without_c(trials, reference_g)
    if len(lacking) > MOST_LEFT_OUT * n:
        return (
            f"{start}{len(lacking)} of {n} trials have no C, because their texture and speed have "
            f"no trial at the reference force of {reference_g:g} g: {_listed(trials, lacking)}"
        )
    return ""


def trials_without_c(trials: TrialSet, reference_g: float) -> list[int]:
    """Return the rows of the trials whose texture and speed have none at the reference force."""
    return [
        row
        for rows in trials.by_condition().values()
        if all(trials.trials[row].force_g != reference_g for row in rows)
        for row in rows
    ]


def with_c(trials: TrialSet, reference_g: float) -> TrialSet:
    """Return the set without the trials that have no C, and a remark that lists those."""
    lacking = trials_without_c(trials, reference_g)
    if not lacking:
        return trials
    return trials.without(
        lacking,
        f"trials left out of every representation, because they have no C: {len(lacking)}; their "
        f"texture and speed have no trial at the reference force of {reference_g:g} g: "
        f"{_listed(trials, lacking)}",
    )


def absence_sentence(force: ForceMatrix) -> str:
    """Return a sentence on the combinations without a C, "" where every one has its C."""
    absent = force.absent_conditions
    if not absent:
        return ""
    listed = [f"{texture} at {v:g} mm/s and {f:g} g" for texture, v, f in absent]
    return (
        f"C has no entry for combinations of texture, speed and force without a trial, or without "
        f"one at the reference force: {len(absent)} ({_shortened(listed)})"
    )


def _listed(trials: TrialSet, rows: Sequence[int]) -> str:
    some = (trials.trials[row] for row in rows)
    return _shortened([f"texture {one.texture} at {one.speed_mm_s:g} mm/s" for one in some])


def _shortened(names: Sequence[str]) -> str:
    different = list(dict.fromkeys(names))
    return ", ".join(different[:MAX_LISTED]) + (" …" if len(different) > MAX_LISTED else "")
