"""Textures told apart on trials that the classifier has not seen: folds, accuracy, confusion."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import sqrt

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

MOST_COMPONENTS = 50
SHOWN_COMPONENTS = 10
N_FOLDS = 4
Z_95 = 1.959963984540054


@dataclass(frozen=True, slots=True)
class LabelledTrials:
    """Complete trials with what was under the sensor.

    ``samples``: uint16 (n_i, n_taxels) each; ``speeds_mm_s`` as planned; ``textures`` by name.
    """

    samples: Sequence[NDArray[np.uint16]]
    speeds_mm_s: Sequence[float]
    textures: Sequence[str]


@dataclass(frozen=True, slots=True)
class HeldOut:
    """Predictions for trials, each made by a classifier that was trained without it.

    ``classes``: names, sorted. ``labels``: int64 (n,), index of each trial's class.
    ``predictions``: int64 (k_max, n), row k − 1 for k principal components. ``shown``: the
    number of components that was chosen before looking, for a single figure of accuracy.
    """

    classes: tuple[str, ...]
    labels: Labels
    predictions: Labels
    n_folds: int
    shown: int

    @property
    def n(self) -> int:
        """Trials tested."""
        return len(self.labels)

    @property
    def chance(self) -> float:
        """Share that always guessing the most frequent class would get right."""
        return float(np.bincount(self.labels).max() / self.n)

    def accuracy(self) -> NDArray[np.float64]:
        """Share of trials told right for k = 1 … k_max, float64 (k_max,)."""
        share: NDArray[np.float64] = (self.predictions == self.labels).mean(axis=1)
        return share

    def correct(self, k: int) -> int:
        """Trials told right with k components."""
        return int((self.predictions[k - 1] == self.labels).sum())

    def confusion(self, k: int) -> Labels:
        """Trials of class i (rows) taken for class j (columns) with k components, int64."""
        table = np.zeros((len(self.classes), len(self.classes)), np.int64)
        np.add.at(table, (self.labels, self.predictions[k - 1]), 1)
        return table


def wilson_interval(correct: int, n: int) -> tuple[float, float]:
    """95 % interval of a proportion (Wilson 1927), for small n honest at both ends."""
    share, z2 = correct / n, Z_95 * Z_95
    middle = (share + z2 / (2 * n)) / (1 + z2 / n)
    half = Z_95 * sqrt(share * (1 - share) / n + z2 / (4 * n * n)) / (1 + z2 / n)
    return max(0.0, middle - half), min(1.0, middle + half)


def stratified_folds(labels: Labels, n_folds: int, seed: int) -> list[Fold]:
    """Folds in which each class is spread as evenly as it goes; each row is tested once.

    Raises :class:`WrongUse` where a class has fewer rows than there are folds.
    """
    fewest = int(np.bincount(labels).min())
    if not 2 <= n_folds <= fewest:
        raise WrongUse(f"{n_folds} folds cannot be made: the smallest class has {fewest} trials")
    random = np.random.default_rng(seed)
    fold_of = np.empty(len(labels), np.int64)
    dealt = 0
    for label in np.unique(labels):
        rows = random.permutation(np.flatnonzero(labels == label))
        # Dealing goes on where the last class ended, so that the folds stay of one size.
        fold_of[rows] = (dealt + np.arange(len(rows))) % n_folds
        dealt += len(rows)
    return [(np.flatnonzero(fold_of != f), np.flatnonzero(fold_of == f)) for f in range(n_folds)]


def classify_held_out(
    trials: LabelledTrials,
    parameters: EncoderParameters = DEFAULT,
    *,
    seed: int = 0,
    progress: Progress = lambda stage, share: None,
) -> HeldOut:
    """Encode, scale to speed, and tell textures apart by PCA + LDA in stratified folds.

    The taxel ranges too come from a fold's training trials alone. Raises :class:`WrongUse` where
    there are fewer than two textures, or a texture with fewer than two trials.
    """
    classes = tuple(sorted(set(trials.textures)))
    labels = np.array([classes.index(name) for name in trials.textures], np.int64)
    folds = stratified_folds(labels, _folds_that_fit(classes, labels), seed)
    lengths = [len(samples) for samples in trials.samples]
    layout = FeatureLayout.covering(lengths, trials.speeds_mm_s, scaled=True)
    k_max = _most_components(folds, len(classes), layout.width(trials.samples[0].shape[1]))
    predictions = np.empty((k_max, len(labels)), np.int64)
    for number, (train, test) in enumerate(folds):
        progress(f"fold {number + 1} of {len(folds)}", number / len(folds))
        ranges = Normalisation.over([trials.samples[i] for i in train], "the fold's training part")
        features = feature_matrices(
            trials.samples, trials.speeds_mm_s, ranges, [layout], parameters
        )[0]
        fold = [(train, test)]
        predictions[:, test] = predict_folds(
            features, labels, fold, k_max, ScatterDivisor.N_LESS_CLASSES
        )[0]
    progress("classified", 1.0)
    shown = min(SHOWN_COMPONENTS, max(1, k_max // 2))
    return HeldOut(classes, labels, predictions, len(folds), shown)


def _folds_that_fit(classes: tuple[str, ...], labels: Labels) -> int:
    if len(classes) < 2:
        raise WrongUse("telling textures apart needs trials of at least two textures")
    counts = np.bincount(labels)
    if counts.min() < 2:
        lonely = classes[int(counts.argmin())]
        raise WrongUse(
            f"texture {lonely} has a single complete trial: record at least two of each texture, "
            "one to learn from and one to test"
        )
    return int(min(N_FOLDS, counts.min()))


def _most_components(folds: Sequence[Fold], n_classes: int, n_features: int) -> int:
    """As many as the smallest training part can carry with a within-class covariance."""
    smallest = min(len(train) for train, _ in folds)
    return max(1, min(MOST_COMPONENTS, smallest - n_classes, n_features))
