"""PCA + LDA for every number of components: our nested sweep, or a scikit-learn fit for each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from rigctl.analysis.classification.component_sweep import (
    Labels,
    Matrix,
    PrincipalComponents,
    Rows,
    fit_fold_pcas,
    fit_nested_lda,
)
from rigctl.analysis.classification.splits import Split

# Below this share of the first component's variance a component is rounding, not data.
RANK_SHARE = 1e-12


class SweepEngine(StrEnum):
    """The implementation that computes a sweep."""

    OWN = "own"
    SKLEARN = "sklearn"


class SweepPredictions(NamedTuple):
    """Predictions int64 (k_max, n_test) of each task, and the numbers of unused components.

    ``without_variance``: components in which the trials of each class are all equal;
    ``beyond_rank``: components that the training trials do not have.
    """

    predictions: dict[str, Labels]
    without_variance: int
    beyond_rank: int


def predict_splits(
    features: Matrix,
    labels: Mapping[str, Labels],
    splits: Sequence[Split],
    k_max: int,
    engine: SweepEngine,
) -> list[SweepPredictions]:
    """Fit each split and predict its tests; ``labels``: of all feature rows, by task key.

    Rows with a label of −1 take part in the principal components of that task, not in its LDA.
    """
    rows = np.unique(np.concatenate([row for s in splits for row in (s.train, *s.tests.values())]))
    dense = np.ascontiguousarray(features[rows])
    position = np.full(len(features), -1, np.intp)
    position[rows] = np.arange(len(rows))
    local = [
        Split(position[split.train], {key: position[test] for key, test in split.tests.items()})
        for split in splits
    ]
    local_labels = {key: values[rows] for key, values in labels.items()}
    pcas = fit_fold_pcas(dense, [split.train for split in local], k_max)
    return [
        _predict_split(dense, local_labels, split, pca, engine)
        for split, pca in zip(local, pcas, strict=True)
    ]


def _predict_split(
    features: Matrix,
    labels: Mapping[str, Labels],
    split: Split,
    pca: PrincipalComponents,
    engine: SweepEngine,
) -> SweepPredictions:
    rank = count_real_components(pca)
    k_max = len(pca.variance)
    tests = {key: test for key, test in split.tests.items() if key in labels}
    if engine is SweepEngine.SKLEARN:
        predictions = {
            key: _predict_with_sklearn(features, labels[key], split.train, test, rank, k_max)
            for key, test in tests.items()
        }
        return SweepPredictions(predictions, 0, k_max - rank)
    train_scores = _scores(pca, features[split.train], rank)
    predictions, dropped = {}, 0
    for key, test in tests.items():
        truth = labels[key][split.train]
        known = truth >= 0
        every = bool(known.all())
        lda = fit_nested_lda(train_scores if every else train_scores[known], truth[known])
        predictions[key] = lda.predict(_scores(pca, features[test], rank))
        dropped = max(dropped, len(lda.dropped) - (k_max - rank))
    return SweepPredictions(predictions, dropped, k_max - rank)


def count_real_components(pca: PrincipalComponents) -> int:
    """Return the number of components that are not rounding, at least 1."""
    real = pca.variance > RANK_SHARE * max(float(pca.variance[0]), 0.0)
    return max(1, int(real.sum()))


def _scores(pca: PrincipalComponents, features: Matrix, rank: int) -> Matrix:
    """Return the scores, with 0 beyond the rank, so that those components take no part."""
    scores = pca.transform(features)
    scores[:, rank:] = 0.0
    return scores


def _predict_with_sklearn(
    features: Matrix, labels: Labels, train: Rows, test: Rows, rank: int, k_max: int
) -> Labels:
    """Fit exact PCA and LDA for each k; beyond the rank the prediction does not change."""
    from sklearn.decomposition import PCA
    from sklearn.discriminant_analysis import LinearDiscriminantAnalysis

    tall = features.shape[1] <= len(train)
    known = train[labels[train] >= 0]
    n, n_classes = len(known), len(np.unique(labels[known]))
    pooled = ScaledCovariance(n / (n - n_classes))
    rows = []
    for k in range(1, rank + 1):
        pca = PCA(k, svd_solver="covariance_eigh" if tall else "full").fit(features[train])
        lda = LinearDiscriminantAnalysis(solver="lsqr", covariance_estimator=pooled)
        lda.fit(pca.transform(features[known]), labels[known])
        rows.append(lda.predict(pca.transform(features[test])))
    rows += [rows[-1]] * (k_max - rank)
    return np.array(rows, np.int64)


@dataclass
class ScaledCovariance:
    """A covariance estimator that gives scikit-learn, which divides by n, another divisor.

    ``covariance_`` is the covariance of the rows, divisor n, times ``factor``.
    """

    factor: float

    def fit(self, rows: Matrix) -> ScaledCovariance:
        """Fit the rows of one class."""
        centred = rows - rows.mean(axis=0)
        self.covariance_ = self.factor * centred.T @ centred / len(rows)
        return self
