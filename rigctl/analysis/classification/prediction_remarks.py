"""Remarks on predictions: taxel ranges, clipping, and conditions that are not in the model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.data.trial_set import TrialSet
from rigctl.session.model_file import Model

MANY_CLIPPED = 0.01
MAX_LISTED_TAXELS = 6


def prediction_remarks(
    model: Model,
    trials: TrialSet,
    unknown: Sequence[str],
    clipped: NDArray[np.float64],
    lengths: Sequence[int],
) -> list[str]:
    """Return all remarks as sentences.

    ``unknown``: textures that the model does not know, one per trial; ``clipped``: share of each
    taxel's readings outside its range; ``lengths``: samples of each trial.
    """
    remarks = [_clipping_remark(model, clipped)]
    if unknown:
        listed = ", ".join(sorted(set(unknown)))
        remarks.append(
            f"{len(unknown)} trials are of textures that are not in the model ({listed}): they "
            "have predictions, but do not count as right or wrong"
        )
    remarks += _length_remarks(model, trials, lengths)
    remarks += _condition_remarks(model, trials)
    if model.force == "texture":
        remarks.append(
            "each trial's SA current was scaled by the C of its own true texture: "
            "the model gets part of the answer"
        )
    if model.training.simulated != trials.simulated:
        origin = "simulated" if model.training.simulated else "real"
        remarks.append(f"the model was trained on {origin} recordings, these are not")
    return remarks


def _clipping_remark(model: Model, clipped: NDArray[np.float64]) -> str:
    start = (
        "readings are scaled by the model's taxel ranges "
        f"({model.normalisation.source}), not by these sessions' own"
    )
    worst = [i for i in np.argsort(-clipped, kind="stable") if clipped[i] > 0][:MAX_LISTED_TAXELS]
    if not worst:
        return f"{start}; no reading is outside them"
    parts = ", ".join(f"taxel {i + 1} {clipped[i]:.2%}" for i in worst)
    many = clipped.max() > MANY_CLIPPED
    cause = " (many: the sensor or its gain may have changed)" if many else ""
    return f"{start}; {clipped.mean():.2%} are outside and are clipped: {parts}{cause}"


def _length_remarks(model: Model, trials: TrialSet, lengths: Sequence[int]) -> list[str]:
    """Return remarks on trials that fill fewer or more windows than the features have."""
    layout = model.features
    spans = [
        int(layout.sample_windows(n, trial.speed_mm_s)[-1]) + 1
        for n, trial in zip(lengths, trials.trials, strict=True)
    ]
    longer = sum(span > layout.n_windows + 1 for span in spans)
    shorter = sum(span < layout.n_windows for span in spans) if layout.scaled else 0
    remarks = []
    if longer:
        remarks.append(
            f"{longer} trials are longer than the model's {layout.n_windows} windows: "
            "their ends are dropped"
        )
    if shorter:
        remarks.append(
            f"{shorter} trials cover less texture than the model's {layout.n_windows} windows: "
            "the missing windows read 0"
        )
    return remarks


def _condition_remarks(model: Model, trials: TrialSet) -> list[str]:
    remarks = []
    for values, trained, unit in (
        (trials.speeds_mm_s, model.training.speeds_mm_s, "mm/s"),
        (trials.forces_g, model.training.forces_g, "g"),
    ):
        new = [f"{value:g}" for value in values if value not in trained]
        if new:
            remarks.append(f"the model was trained on no trial at {', '.join(new)} {unit}")
    return remarks
