"""PCA + LDA for every number of components: our nested sweep, or scikit-learn fitted anew."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.classification.component_sweep import (
    Labels,
    Matrix,
    PrincipalComponents,
    ScatterDivisor,
    fit_nested_lda,
    fit_principal,
    fold_principals,
)
from rigctl.analysis.classification.splits import Rows, Split

# Below this share of the first component's variance a component is rounding, not data.
RANK_SHARE = 1e-12


class SweepEngine(StrEnum):
    """Who computes."""

    OWN = "own"
    SKLEARN = "sklearn"


class SweepPredictions(NamedTuple):
    """Predictions int64 (k_max, n_test) of each task, and how many components were set aside.

    ``without_variance``: components in which the trials of each class are all equal;
    ``beyond_rank``: components that the training trials do not have.
    """

    predictions: dict[str, Labels]
    without_variance: int
    beyond_rank: int


def answer(
    features: Matrix,
    labels: Mapping[str, Labels],
    fits: Sequence[Split],
    k_max: int,
    engine: SweepEngine,
) -> list[SweepPredictions]:
    """Fit each split and ask its tests. ``labels``: of all rows of ``features``, by task key."""
    rows = np.unique(np.concatenate([_rows_of(fit) for fit in fits]))
    near = np.ascontiguousarray(features[rows])
    place = np.full(len(features), -1, np.intp)
    place[rows] = np.arange(len(rows))
    local = [
        Split(place[fit.train], {key: place[test] for key, test in fit.tests.items()})
        for fit in fits
    ]
    known = {key: values[rows] for key, values in labels.items()}
    return [
        _asked(near, known, fit, principal, engine)
        for fit, principal in zip(local, _principals(near, local, k_max), strict=True)
    ]


def _rows_of(fit: Split) -> Rows:
    return np.concatenate([fit.train, *fit.tests.values()])


def _principals(features: Matrix, fits: Sequence[Split], k_max: int) -> list[PrincipalComponents]:
    if len(fits) == 1:
        return [fit_principal(features[fits[0].train], k_max)]
    return fold_principals(features, [(fit.train, fit.train[:0]) for fit in fits], k_max)


def _asked(
    features: Matrix,
    labels: Mapping[str, Labels],
    fit: Split,
    principal: PrincipalComponents,
    engine: SweepEngine,
) -> SweepPredictions:
    rank = _rank(principal)
    k_max = len(principal.variance)
    tests = {key: test for key, test in fit.tests.items() if key in labels}
    if engine is SweepEngine.SKLEARN:
        found = {
            key: _by_sklearn(features, labels[key], fit.train, test, rank, k_max)
            for key, test in tests.items()
        }
        return SweepPredictions(found, 0, k_max - rank)
    learnt = _scores(principal, features[fit.train], rank)
    predictions, dropped = {}, 0
    for key, test in tests.items():
        lda = fit_nested_lda(learnt, labels[key][fit.train], ScatterDivisor.N_LESS_CLASSES)
        predictions[key] = lda.predictions(_scores(principal, features[test], rank))
        dropped = max(dropped, len(lda.dropped) - (k_max - rank))
    return SweepPredictions(predictions, dropped, k_max - rank)


def _rank(principal: PrincipalComponents) -> int:
    real = principal.variance > RANK_SHARE * max(float(principal.variance[0]), 0.0)
    return max(1, int(real.sum()))


def _scores(principal: PrincipalComponents, features: Matrix, rank: int) -> Matrix:
    """Scores; components beyond the rank are 0 and so take no part."""
    scores = principal.scores(features)
    scores[:, rank:] = 0.0
    return scores


def _by_sklearn(
    features: Matrix, labels: Labels, train: Rows, test: Rows, rank: int, k_max: int
) -> Labels:
    """A pipeline of exact PCA and LDA for each k; beyond the rank the answer stays."""
    from sklearn.decomposition import PCA
    from sklearn.discriminant_analysis import LinearDiscriminantAnalysis

    tall = features.shape[1] <= len(train)
    n, n_classes = len(train), len(np.unique(labels[train]))
    pooled = _pooled_over_n_less_classes(n / (n - n_classes))
    rows = []
    for k in range(1, rank + 1):
        pca = PCA(k, svd_solver="covariance_eigh" if tall else "full").fit(features[train])
        lda = LinearDiscriminantAnalysis(solver="lsqr", covariance_estimator=pooled)
        lda.fit(pca.transform(features[train]), labels[train])
        rows.append(lda.predict(pca.transform(features[test])))
    rows += [rows[-1]] * (k_max - rank)
    return np.array(rows, np.int64)


def _pooled_over_n_less_classes(factor: float) -> Any:
    """A covariance estimator for scikit-learn, whose own divides by n instead of n − classes."""
    from sklearn.base import BaseEstimator

    class ScaledCovariance(BaseEstimator):  # type: ignore[misc]  # scikit-learn has no types
        """A class's covariance times a factor."""

        def __init__(self, factor: float) -> None:
            self.factor = factor

        def fit(self, rows: NDArray[np.float64]) -> ScaledCovariance:
            """Learn from the rows of one class."""
            centred = rows - rows.mean(axis=0)
            self.covariance_ = self.factor * centred.T @ centred / len(rows)
            return self

    return ScaledCovariance(factor)
