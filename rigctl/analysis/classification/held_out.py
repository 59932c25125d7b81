"""Held-out classification of textures in stratified folds: predictions, accuracy, confusion."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.classification.component_sweep import (
    Fold,
    Labels,
    ScatterDivisor,
    predict_folds,
)
from rigctl.encoding.features import FeatureLayout, feature_matrices
from rigctl.encoding.normalisation import Normalisation
from rigctl.encoding.parameters import DEFAULT, EncoderParameters
from rigctl.errors import WrongUse

Progress = Callable[[str, float], None]

MAX_COMPONENTS = 50
SHOWN_COMPONENTS = 10
N_FOLDS = 4
SEEDS = 2**32


@dataclass(frozen=True, slots=True)
class LabelledTrials:
    """Complete trials with their textures.

    ``samples``: uint16 (n_i, n_taxels) each; ``speeds_mm_s`` as planned; ``textures`` by name.
    """

    samples: Sequence[NDArray[np.uint16]]
    speeds_mm_s: Sequence[float]
    textures: Sequence[str]


@dataclass(frozen=True, slots=True)
class HeldOutPredictions:
    """Predictions for trials, each from a classifier that was trained without that trial.

    ``classes``: names, sorted. ``labels``: int64 (n,), index of each trial's class.
    ``predictions``: int64 (k_max, n), row k − 1 for k principal components. ``shown_components``:
    the number of components, chosen in advance, for a single figure of accuracy.
    """

    classes: tuple[str, ...]
    labels: Labels
    predictions: Labels
    n_folds: int
    shown_components: int

    @property
    def n(self) -> int:
        """Number of tested trials."""
        return len(self.labels)

    @property
    def chance(self) -> float:
        """Accuracy of always guessing the most frequent class."""
        return float(np.bincount(self.labels).max() / self.n)

    def correct_counts(self) -> Labels:
        """Return the number of correct predictions for k = 1 … k_max, int64 (k_max,)."""
        counts: Labels = (self.predictions == self.labels).sum(axis=1)
        return counts

    def confusion(self, k: int) -> Labels:
        """Return the confusion matrix with k components, int64; rows: true, columns: predicted."""
        matrix = np.zeros((len(self.classes), len(self.classes)), np.int64)
        np.add.at(matrix, (self.labels, self.predictions[k - 1]), 1)
        return matrix


def classify_held_out(
    trials: LabelledTrials,
    parameters: EncoderParameters = DEFAULT,
    *,
    seed: int = 0,
    progress: Progress = lambda stage, share: None,
) -> HeldOutPredictions:
    """Encode trials, scale them to speed, and classify textures by PCA + LDA in stratified folds.

    The taxel ranges also come from a fold's training trials alone. Raises :class:`WrongUse` for
    fewer than two textures, or a texture with fewer than two trials.
    """
    classes = tuple(sorted(set(trials.textures)))
    labels = np.array([classes.index(name) for name in trials.textures], np.int64)
    folds = _folds(classes, labels, seed)
    lengths = [len(samples) for samples in trials.samples]
    layout = FeatureLayout.covering(lengths, trials.speeds_mm_s, scaled=True)
    k_max = _k_max(folds, len(classes), layout.n_features(trials.samples[0].shape[1]))
    predictions = np.empty((k_max, len(labels)), np.int64)
    for number, (train, test) in enumerate(folds):
        progress(f"fold {number + 1} of {len(folds)}", number / len(folds))
        ranges = Normalisation.from_samples(
            [trials.samples[i] for i in train], "the fold's training part"
        )
        features = feature_matrices(
            trials.samples, trials.speeds_mm_s, ranges, [layout], parameters
        )[0]
        predictions[:, test] = predict_folds(
            features, labels, [(train, test)], k_max, ScatterDivisor.N_LESS_CLASSES
        )[0]
    progress("classified", 1.0)
    shown = min(SHOWN_COMPONENTS, max(1, k_max // 2))
    return HeldOutPredictions(classes, labels, predictions, len(folds), shown)


def _folds(classes: tuple[str, ...], labels: Labels, seed: int) -> list[Fold]:
    """Return four stratified folds, or as many as the smallest class has trials."""
    if len(classes) < 2:
        raise WrongUse("telling textures apart needs trials of at least two textures")
    counts = np.bincount(labels)
    if counts.min() < 2:
        raise WrongUse(
            f"texture {classes[int(counts.argmin())]} has a single complete trial: record at "
            "least two of each texture, one to train on and one to test"
        )
    from sklearn.model_selection import StratifiedKFold

    n_folds = int(min(N_FOLDS, counts.min()))
    # scikit-learn takes 32 bits of a seed.
    folds = StratifiedKFold(n_folds, shuffle=True, random_state=seed % SEEDS)
    return list(folds.split(labels, labels))


def _k_max(folds: Sequence[Fold], n_classes: int, n_features: int) -> int:
    """Return how many components the smallest training part allows LDA to use."""
    smallest = min(len(train) for train, _ in folds)
    return max(1, min(MAX_COMPONENTS, smallest - n_classes, n_features))
