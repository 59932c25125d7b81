"""What is to be said of a model's answers: ranges, clipping, what it never learnt."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.data.trial_set import TrialSet
from rigctl.session.files.model import Model

LOUD_SHARE = 0.01
NAMED_TAXELS = 6


def sentences(
    model: Model,
    trials: TrialSet,
    new: Sequence[str],
    clipped: NDArray[np.float64],
    lengths: Sequence[int],
) -> list[str]:
    """All that goes with the answers. ``new``: the texture of each trial that the model does not
    know; ``clipped``: share of each taxel's readings; ``lengths``: samples of each trial.
    """
    said = [_clip_sentence(model, clipped)]
    if new:
        named = ", ".join(sorted(set(new)))
        said.append(
            f"{len(new)} trials are of textures that the model does not know ({named}): they are "
            "answered, but not counted as right or wrong"
        )
    said += _length_sentences(model, trials, lengths)
    said += _new_conditions(model, trials)
    if model.force == "texture":
        said.append(
            "each trial's SA current was scaled by the C of its own true texture: "
            "the model was told part of the answer"
        )
    if model.training.simulated != trials.simulated:
        whose = "simulated" if model.training.simulated else "real"
        said.append(f"the model was trained on {whose} recordings, these are not")
    return said


def _clip_sentence(model: Model, clipped: NDArray[np.float64]) -> str:
    start = (
        "readings are scaled by the model's taxel ranges "
        f"({model.normalisation.source}), not by these sessions' own"
    )
    worst = [i for i in np.argsort(-clipped, kind="stable") if clipped[i] > 0][:NAMED_TAXELS]
    if not worst:
        return f"{start}; none lies outside them"
    parts = ", ".join(f"taxel {i + 1} {clipped[i]:.2%}" for i in worst)
    more = " (many: the sensor or its gain may have changed)" if clipped.max() > LOUD_SHARE else ""
    return f"{start}; {clipped.mean():.2%} lie outside and are clipped: {parts}{more}"


def _length_sentences(model: Model, trials: TrialSet, lengths: Sequence[int]) -> list[str]:
    """Trials that fill fewer or more windows than a vector has."""
    layout = model.features
    spans = [
        int(layout.windows(n, trial.speed_mm_s)[-1]) + 1
        for n, trial in zip(lengths, trials.trials, strict=True)
    ]
    longer = sum(span > layout.n_windows + 1 for span in spans)
    shorter = sum(span < layout.n_windows for span in spans) if layout.scaled else 0
    said = []
    if longer:
        said.append(
            f"{longer} trials are longer than the model's {layout.n_windows} windows: "
            "the rest of them is dropped"
        )
    if shorter:
        said.append(
            f"{shorter} trials cover less texture than the model's {layout.n_windows} windows: "
            "what is missing reads 0"
        )
    return said


def _new_conditions(model: Model, trials: TrialSet) -> list[str]:
    learnt = model.training
    said = []
    for values, known, unit in (
        (trials.speeds_mm_s, learnt.speeds_mm_s, "mm/s"),
        (trials.forces_g, learnt.forces_g, "g"),
    ):
        new = [f"{v:g}" for v in values if v not in known]
        if new:
            said.append(f"the model learnt from no trial at {', '.join(new)} {unit}")
    return said
