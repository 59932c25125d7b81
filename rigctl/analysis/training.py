"""A model that is trained on every trial of an analysed set, without a draw."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rigctl import __version__
from rigctl.analysis import published
from rigctl.analysis.executors import Progress
from rigctl.analysis.force_gains import NO_PASSPORT
from rigctl.analysis.pca_lda import fit_classifier
from rigctl.analysis.representations import REPRESENTATIONS, Representation, RepresentationSet
from rigctl.analysis.trial_set import Design
from rigctl.config.resources import source_commit
from rigctl.encoder.force_gain import LOADCELL, ForceScaling
from rigctl.errors import WrongUse
from rigctl.session.analysis_file import content_digest
from rigctl.session.model_file import C_USES, Model, TrainingInfo

STAGE = "training the model, hashing its sessions"


@dataclass(frozen=True, slots=True)
class ModelRequest:
    """The model to save: a representation by name or key, and the number of components."""

    path: Path
    representation: str = "speed"
    components: int = published.K_MAX

    def __post_init__(self) -> None:
        if self.components < 1:
            raise WrongUse("a model needs one component or more")
        find_representation(self.representation)


def find_representation(name: str) -> Representation:
    """Return a representation by name or key. Raises WrongUse with a list of the names."""
    plain = name.strip().lower()
    for representation in REPRESENTATIONS:
        if plain in (representation.key, representation.name.lower()):
            return representation
    names = ", ".join(f"{r.name!r}" for r in REPRESENTATIONS)
    raise WrongUse(f"there is no representation {name!r}: choose one of {names}")


def train_model(
    encoded: RepresentationSet,
    request: ModelRequest,
    made_utc: str,
    seed: int,
    progress: Progress = lambda stage, done, total: None,
) -> tuple[Model, str]:
    """Fit PCA and LDA on all trials of a set; return the model and a sentence on it.

    The model has the requested number of components, or fewer where the trials do not allow it.
    Raises WrongUse where the set lacks the representation, or has too few trials or textures.
    """
    representation = find_representation(request.representation)
    if representation not in encoded.present:
        is_calibrated = representation.force in (ForceScaling.CALIBRATED, LOADCELL)
        why = (
            NO_PASSPORT.format(path=encoded.trials.paths[0])
            if is_calibrated
            else "the remarks say why"
        )
        raise WrongUse(
            f"cannot train a model: the set has no {representation.name} representation, {why}"
        )
    design = Design.from_trials(encoded.trials)
    n, n_classes = len(design.texture), len(design.textures)
    features = encoded.features(representation)
    most = min(n - n_classes, features.shape[1], request.components)
    if n_classes < 2 or most < 1:
        raise WrongUse(f"cannot train a model on {n} trials of {n_classes} textures: record more")
    ranges, parameters = encoded.encoder(representation)
    model = Model(
        *fit_classifier(np.asarray(features), design.texture, most),
        representation=representation.name,
        key=representation.key,
        force=representation.force,
        classes=design.textures,
        parameters=parameters,
        normalisation=ranges,
        features=encoded.layout(representation),
        c=encoded.force if representation.force in C_USES else None,
        training=_training(encoded, made_utc, seed, progress),
    )
    return model, _sentence(model, request)


def _training(
    encoded: RepresentationSet, made_utc: str, seed: int, progress: Progress
) -> TrainingInfo:
    trials = encoded.trials
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
        frozenset(encoded.hashes.tolist()),
    )


def _sentence(model: Model, request: ModelRequest) -> str:
    fewer = ""
    if model.components < request.components:
        fewer = f" (of {request.components} requested, as many as its trials allow)"
    caution = ""
    if model.force == "texture":
        caution = (
            "; its C depends on the true texture, so it classifies only trials of known texture, "
            "and gets part of the answer"
        )
    return (
        f"model {request.path}: {model.representation}, {model.components} components{fewer}, "
        f"{len(model.classes)} textures, trained on all {model.training.trials} trials; the "
        f"accuracies of this report are of other fits, each tested on unseen trials{caution}"
    )
