"""A model out of an analysed set: every trial is learnt from, and nothing is drawn."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rigctl import __version__
from rigctl.analysis.classification.component_sweep import fit_nested_lda, fit_principal
from rigctl.analysis.classification.splits import Design
from rigctl.analysis.classification.sweep_engines import RANK_SHARE
from rigctl.analysis.execution.executor import Progress
from rigctl.analysis.features.representations import (
    REPRESENTATIONS,
    Representation,
    RepresentationSet,
)
from rigctl.analysis.paper import published
from rigctl.config.resources import source_commit
from rigctl.errors import WrongUse
from rigctl.session.files.model import Model, TrainingInfo
from rigctl.session.files.source_sessions import content_digest

STAGE = "training the model, noting its sessions by content"


@dataclass(frozen=True, slots=True)
class ModelRequest:
    """Which model is to be kept: a representation by name or key, and how many components."""

    path: Path
    representation: str = "speed"
    components: int = published.K_MAX

    def __post_init__(self) -> None:
        if self.components < 1:
            raise WrongUse("a model has one component or more")
        named(self.representation)


def named(words: str) -> Representation:
    """A representation by its name or its key. Raises WrongUse with those there are."""
    plain = words.strip().lower()
    for representation in REPRESENTATIONS:
        if plain in (representation.key, representation.name.lower()):
            return representation
    known = ", ".join(f"{r.name!r}" for r in REPRESENTATIONS)
    raise WrongUse(f"there is no representation {words!r}: choose one of {known}")


def train(
    made: RepresentationSet,
    request: ModelRequest,
    made_utc: str,
    seed: int,
    progress: Progress = lambda stage, done, all_: None,
) -> tuple[Model, str]:
    """Fit PCA and LDA on all trials of a set; the model, and a sentence on it.

    There are as many components as asked for, or as the trials carry. Raises WrongUse where the
    set does not have the representation, or too few trials of too few textures.
    """
    representation = named(request.representation)
    if representation not in made.present:
        raise WrongUse(
            f"no model can be made: the set has no {representation.name} representation, "
            "the remarks say why"
        )
    design = Design.of(made.trials)
    n, n_classes = len(design.texture), len(design.textures)
    features = made.features(representation)
    most = min(n - n_classes, features.shape[1], request.components)
    if n_classes < 2 or most < 1:
        raise WrongUse(f"no model can be made of {n} trials of {n_classes} textures: record more")
    principal = fit_principal(np.asarray(features), most)
    # A component that the trials do not have is rounding; it would only add noise.
    k = max(1, int((principal.variance > RANK_SHARE * principal.variance[0]).sum()))
    # Another order in memory would let the last bit of a product differ after reading it back.
    axes = np.ascontiguousarray(principal.axes[:, :k])
    lda = fit_nested_lda(principal.scores(features)[:, :k], design.texture)
    model = Model(
        representation.name,
        representation.key,
        representation.force,
        design.textures,
        made.parameters,
        made.normalisation,
        made.scaled if representation.speed_scaled else made.unscaled,
        np.ascontiguousarray(principal.mean),
        axes,
        np.ascontiguousarray(principal.variance[:k]),
        np.ascontiguousarray(lda.factor),
        np.ascontiguousarray(lda.whitened_means),
        np.ascontiguousarray(lda.log_priors),
        np.array(lda.dropped, np.int64),
        made.force if representation.force else None,
        _training(made, made_utc, seed, progress),
    )
    return model, _sentence(model, request)


def _training(
    made: RepresentationSet, made_utc: str, seed: int, progress: Progress
) -> TrainingInfo:
    trials = made.trials
    inputs = []
    for number, (path, source) in enumerate(zip(trials.paths, trials.provenance, strict=True)):
        progress(STAGE, number, len(trials.paths))
        inputs.append({**source, "content": content_digest(path)})
    progress(STAGE, len(trials.paths), len(trials.paths))
    return TrainingInfo(
        made_utc,
        __version__,
        source_commit(),
        seed,
        trials.simulated,
        len(trials.trials),
        trials.speeds_mm_s,
        trials.forces_g,
        tuple(inputs),
    )


def _sentence(model: Model, request: ModelRequest) -> str:
    fewer = ""
    if model.components < request.components:
        fewer = f" (of {request.components} asked for, as many as its trials carry)"
    knows = ""
    if model.force == "texture":
        knows = (
            "; its C is indexed by the true texture, so it answers only for trials whose texture "
            "is known, and has been told part of the answer"
        )
    return (
        f"model {request.path}: {model.representation}, {model.components} components{fewer}, "
        f"{len(model.classes)} textures, learnt from all {model.training.trials} trials; the "
        f"accuracies of this report are of other fits, each tested on trials it had not seen{knows}"
    )
