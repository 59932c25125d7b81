"""Compute the paper's six accuracies of the Original representation with the analysis code.

No other representation is computed, nor anything they need: neither C nor scaled time.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis import published
from rigctl.analysis.pca_lda import Split
from rigctl.analysis.splits import Design, make_splits, stratified_folds
from rigctl.analysis.tasks import score_splits
from rigctl.encoding.batch import common_bin_edges, count_spikes, features_from_counts
from rigctl.encoding.features import UNSCALED
from rigctl.encoding.normalisation import Normalisation
from rigctl.identification.sliding import SlideSession
from rigctl.values import N_TAXELS

TASKS = tuple(task for task in published.TASKS if task.key in published.TABLE_1)
PAPER = {key: cells["original"][0] for key, cells in published.TABLE_1.items()}
"""Per cent with 50 components; the only published column that the search reads."""

DRAWS = 4


def accuracies(slides: SlideSession, seed: int) -> dict[str, float]:
    """Return the accuracy of each task with 50 components, per cent."""
    features, design = slide_features(slides), slides.design
    fits = [_folds(design, seed)]
    fits += [make_splits(design, "extrapolation", seed, draw) for draw in range(DRAWS)]
    correct, tested = (dict.fromkeys(PAPER, 0) for _ in range(2))
    for splits in fits:
        tasks = [task for task in TASKS if task.key in splits[0].tests]
        for key, score in score_splits(features, design, splits, tasks, published.K_MAX).items():
            correct[key] += int(score.correct[-1])
            tested[key] += score.n_tested
    return {key: 100.0 * (correct[key] / tested[key]) for key in PAPER}


def slide_features(slides: SlideSession) -> NDArray[np.float64]:
    """Return features of 100 ms windows in real time, float64 (n_trials, 2160)."""
    ranges = Normalisation.from_samples(slides.samples, "all trials")
    out = np.empty((len(slides.samples), UNSCALED.n_features(N_TAXELS)))
    for speed in np.unique(slides.design.speed_mm_s):
        rows = np.flatnonzero(slides.design.speed_mm_s == speed)
        trials = [slides.samples[row] for row in rows]
        lengths = [len(trial) for trial in trials]
        cuts = common_bin_edges([UNSCALED], max(lengths), float(speed))
        counts = count_spikes(trials, cuts, ranges)
        out[rows] = features_from_counts(counts, cuts, lengths, float(speed), UNSCALED)
    return out


def _folds(design: Design, seed: int) -> list[Split]:
    """Split all trials into four folds: a third of so few would be too little for training."""
    folds = stratified_folds(design.texture, published.N_FOLDS, seed)
    return [Split(train, {"textures": test, "groups": test}) for train, test in folds]
