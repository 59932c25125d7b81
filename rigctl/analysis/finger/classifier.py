"""The classifier of the live experiment: trained on one session, centred by the next one's mean.

PCA is centred, not standardised, and LDA has pooled covariance and empirical priors, as everywhere.
Each number of windows has a classifier of its own, trained on so many windows of the training
scans; that of all windows is the paper's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from rigctl.analysis.finger.published import COMPONENTS
from rigctl.analysis.finger.scans import ScanKind, ScanSet
from rigctl.analysis.pca_lda import (
    count_real_components,
    fit_nested_lda,
    fit_pca,
    log_posteriors,
    whiten,
)
from rigctl.encoding.normalisation import Normalisation
from rigctl.encoding.parameters import DEFAULT, EncoderParameters
from rigctl.encoding.scaled_time import REFERENCE_UM_PER_S, feature_vector
from rigctl.errors import WrongUse
from rigctl.session.files.finger_model_file import FingerCalibration, FingerModel, WindowClassifier
from rigctl.session.files.model_file import TrainingInfo

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


class FingerEncoding(NamedTuple):
    """What turns readings into windows: a model is valid only for scans of its own."""

    normalisation: Normalisation
    parameters: EncoderParameters = DEFAULT
    reference_um_per_s: int = REFERENCE_UM_PER_S
    sensor: str = ""


def train_finger_model(
    scans: ScanSet,
    kind: ScanKind,
    encoding: FingerEncoding,
    training: TrainingInfo,
    components: int = COMPONENTS,
) -> FingerModel:
    """Return a model of training scans, without a calibration.

    Raises :class:`WrongUse` where the scans are too few or of a single texture.
    """
    stages = train_stages(scans, kind, scans.textures, components)
    return FingerModel(
        kind.value,
        scans.textures,
        encoding.parameters,
        encoding.normalisation,
        encoding.reference_um_per_s,
        encoding.sensor,
        stages,
        training,
    )


def train_stages(
    scans: ScanSet, kind: ScanKind, textures: Sequence[str], components: int = COMPONENTS
) -> tuple[WindowClassifier, ...]:
    """Return the classifiers of 1 to 20 windows."""
    if components < 1:
        raise WrongUse("a model needs one component or more")
    labels = scans.labels(textures)
    features = [stage_features(scans, kind, n) for n in range(1, scans.n_windows + 1)]
    return tuple(_fit(rows, labels, components) for rows in features)


def stage_features(scans: ScanSet, kind: ScanKind, n_windows: int) -> Floats:
    """Return the features of the classifier of ``n_windows``, float64 (n, taxels · n_windows).

    That of all windows takes whole scans: for Original their last 20 windows.
    """
    if n_windows == scans.n_windows:
        return scans.features(kind)
    return feature_vector(scans.evidence(kind, n_windows)[:, :n_windows])


def calibrate_finger_model(model: FingerModel, scans: ScanSet) -> FingerModel:
    """Return the model with the mean of a session's calibration trials, and their predictions.

    Raises :class:`WrongUse` for other textures than the model's, or a single trial.
    """
    if scans.textures != model.textures:
        raise WrongUse(
            f"{scans.session} calibrates the textures {', '.join(scans.textures)}, the model knows "
            f"{', '.join(model.textures)}: calibrate with all of them and no other"
        )
    if len(scans) < 2:
        raise WrongUse(f"{scans.session} has one calibration trial: the mean needs more")
    kind = ScanKind(model.representation)
    mean = scans.features(kind).mean(axis=0)
    labels = scans.labels(model.textures)
    scores = [
        _score_left_out(stage, stage_features(scans, kind, n))
        for n, stage in enumerate(model.stages, start=1)
    ]
    logs, distances = (np.stack(part) for part in zip(*scores, strict=True))
    return replace(model, calibration=FingerCalibration(mean, labels, logs, distances))


def centred_stages(model: FingerModel, stages_mean: Floats | None = None) -> list[WindowClassifier]:
    """Return the classifiers with the calibration's mean in place of the training mean.

    ``stages_mean``: another mean of whole scans, float64 (p,).
    """
    if stages_mean is None:
        if model.calibration is None:
            return list(model.stages)
        stages_mean = model.calibration.mean
    windows = stages_mean.reshape(model.n_taxels, -1)
    return [
        replace(stage, mean=np.ascontiguousarray(windows[:, :n]).reshape(-1))
        for n, stage in enumerate(model.stages, start=1)
    ]


def nearest_distances(classifier: WindowClassifier, features: Floats) -> Floats:
    """Return each row's squared distance to the nearest class, float64 (n,).

    In units of the spread within a class, over the model's components.
    """
    white = whiten(classifier, features)
    offsets = white[:, :, None] - classifier.whitened_means
    return np.asarray((offsets * offsets).sum(axis=1).min(axis=1))


def board_coefficients(model: FingerModel) -> tuple[Floats, Floats]:
    """Return what the board's classifier takes: (classes, components) and (classes,), float64.

    Discriminants are coefficients · scores + intercepts, for whole scans.
    """
    stage = model.stages[-1]
    factor, means = stage.factor.copy(), stage.whitened_means.copy()
    factor[stage.dropped, stage.dropped] = 1.0
    means[stage.dropped] = 0.0
    solved = linalg.solve_triangular(factor, means, lower=True, trans="T")
    solved[stage.dropped] = 0.0
    intercepts = stage.log_priors - 0.5 * (means * means).sum(axis=0)
    return np.ascontiguousarray(solved.T), intercepts


def check_finger_model(model: FingerModel, encoding: FingerEncoding) -> None:
    """Raise :class:`WrongUse` for a model of another sensor, ranges, encoder or reference speed."""
    same_ranges = model.normalisation.has_ranges_of(encoding.normalisation)
    for equal, what in (
        (model.sensor == encoding.sensor, f"the sensor {model.sensor!r}, not {encoding.sensor!r}"),
        (same_ranges, "other taxel ranges"),
        (model.parameters == encoding.parameters, "other encoder parameters"),
        (
            model.reference_um_per_s == encoding.reference_um_per_s,
            f"a reference speed of {model.reference_um_per_s / 1000:g} mm/s, not "
            f"{encoding.reference_um_per_s / 1000:g}",
        ),
    ):
        if not equal:
            raise WrongUse(f"the model was trained with {what}: train one for this finger")


def _fit(features: Floats, labels: Integers, components: int) -> WindowClassifier:
    most = min(len(features) - len(np.unique(labels)), features.shape[1], components)
    if most < 1:
        raise WrongUse(f"{len(features)} training trials are too few for a classifier: record more")
    pca = fit_pca(features, most)
    k = count_real_components(pca)
    # Another memory order could change the last bit of a product after the file is read.
    axes = np.ascontiguousarray(pca.axes[:, :k])
    lda = fit_nested_lda(pca.transform(features)[:, :k], labels)
    return WindowClassifier(
        np.ascontiguousarray(pca.mean),
        axes,
        np.ascontiguousarray(pca.variance[:k]),
        np.ascontiguousarray(lda.factor),
        np.ascontiguousarray(lda.whitened_means),
        np.ascontiguousarray(lda.log_priors),
        np.array(lda.dropped, np.int64),
    )


def _score_left_out(stage: WindowClassifier, features: Floats) -> tuple[Floats, Floats]:
    """Return log posteriors and distances of trials, each centred by the mean of the others."""
    n, mean = len(features), features.mean(axis=0)
    # x less the mean of the others is n / (n − 1) times x less the mean of all.
    centred = mean + (features - mean) * (n / (n - 1))
    moved = replace(stage, mean=mean)
    return log_posteriors(moved, centred), nearest_distances(moved, centred)
