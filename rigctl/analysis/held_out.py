"""Held-out classification of textures in stratified folds: predictions, accuracy, confusion."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.executors import Progress
from rigctl.analysis.pca_lda import Labels, Split, SweepEngine, predict_splits
from rigctl.analysis.splits import LEAST_TRIALS, Fold
from rigctl.analysis.trial_set import Design, TrialSet
from rigctl.encoder.features import FeatureLayout, feature_matrices
from rigctl.encoder.normalisation import Normalisation
from rigctl.errors import WrongUse

MAX_COMPONENTS = 50
SHOWN_COMPONENTS = 10
N_FOLDS = 4
SEEDS = 2**32
TASK = "textures"


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

    def confusion(self) -> Labels:
        """Return the confusion matrix with the shown components, int64; rows: true."""
        matrix = np.zeros((len(self.classes), len(self.classes)), np.int64)
        np.add.at(matrix, (self.labels, self.predictions[self.shown_components - 1]), 1)
        return matrix


def with_repeats(trials: TrialSet) -> TrialSet:
    """Return the set without textures of a single trial, which cannot be trained and tested.

    The set itself where fewer than two textures would be left.
    """
    counts = Counter(trial.texture for trial in trials.trials)
    single = sorted(name for name, n in counts.items() if n < LEAST_TRIALS["folds"])
    if not single or len(counts) - len(single) < 2:
        return trials
    rows = [row for row, trial in enumerate(trials.trials) if trial.texture in single]
    return trials.without(rows, f"textures left out for a single trial: {', '.join(single)}")


def classify_held_out(
    samples: Sequence[NDArray[np.uint16]],
    design: Design,
    *,
    seed: int = 0,
    progress: Progress = lambda stage, done, total: None,
) -> HeldOutPredictions:
    """Encode trials, scale them to speed, and classify textures by PCA + LDA in stratified folds.

    ``samples``: uint16 (n_i, n_taxels) of each trial of ``design``. The taxel ranges also come from
    a fold's training trials alone. Raises :class:`WrongUse` for fewer than two textures, or a
    texture with fewer than two trials.
    """
    folds = _folds(design, seed)
    speeds = design.speed_mm_s.tolist()
    layout = FeatureLayout.covering(list(map(len, samples)), speeds, scaled=True)
    smallest = min(len(train) for train, _ in folds)
    n_features = layout.n_features(samples[0].shape[1])
    k_max = max(1, min(MAX_COMPONENTS, smallest - len(design.textures), n_features))
    predictions = np.empty((k_max, len(samples)), np.int64)
    for number, (train, test) in enumerate(folds):
        progress("classifying", number, len(folds))
        ranges = Normalisation.from_samples([samples[i] for i in train], "training part")
        (features,) = feature_matrices(samples, speeds, ranges, [layout])
        split = Split(train, {TASK: test})
        labels = {TASK: design.texture}
        (sweep,) = predict_splits(features, labels, [split], k_max, SweepEngine.OWN)
        predictions[:, test] = sweep.predictions[TASK]
    progress("classifying", len(folds), len(folds))
    shown = min(SHOWN_COMPONENTS, max(1, k_max // 2))
    return HeldOutPredictions(design.textures, design.texture, predictions, len(folds), shown)


def _folds(design: Design, seed: int) -> list[Fold]:
    """Return four stratified folds, or as many as the smallest class has trials."""
    if len(design.textures) < 2:
        raise WrongUse("classifying textures needs trials of at least two textures")
    counts = np.bincount(design.texture)
    if counts.min() < 2:
        raise WrongUse(
            f"texture {design.textures[int(counts.argmin())]} has a single complete trial: record "
            "at least two of each texture, one to train on and one to test"
        )
    from sklearn.model_selection import StratifiedKFold

    n_folds = int(min(N_FOLDS, counts.min()))
    # scikit-learn takes 32 bits of a seed.
    folds = StratifiedKFold(n_folds, shuffle=True, random_state=seed % SEEDS)
    return list(folds.split(design.texture, design.texture))
