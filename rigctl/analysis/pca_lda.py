"""PCA and LDA for every number of components together, exactly as separate fits give them.

Principal components are nested: a fit of k components gives the first k of a fit of fifty. The
Cholesky factor of the within-class covariance of their scores is nested, too, and so is the forward
substitution. One decomposition therefore serves every k, and a discriminant for k components is
that for k − 1 plus one term. Training folds share their work too: a fold's covariance is the total
less the test block's. PCA is centred, not standardised; LDA has pooled covariance and empirical
priors. A scikit-learn fit for each k is the other engine.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from rigctl.errors import WrongUse
from rigctl.session.model_file import Classifier

Matrix = NDArray[np.float64]
Labels = NDArray[np.int64]
Rows = NDArray[np.intp]
ClassifierArrays = tuple[Matrix, Matrix, Matrix, Matrix, Matrix, Matrix, Labels]
# A component whose within-class variance is this small a part of its whole variance, given the
# components before it, is numerically without any; dividing by it would amplify rounding.
NO_VARIANCE = 1e-12
# From so many features on, and for so small a share of them, Lanczos' method beats LAPACK's.
LANCZOS_FEATURES = 600
LANCZOS_SHARE = 8
# Components come from products of rows where the last has at least this part of the first's
# variance: then their axes are correct to ten digits.
FINE_SHARE = 1e-6
# Folds whose scatters, p × p each, are in memory together.
FOLDS_IN_MEMORY = 8
# Below this share of the first component's variance a component is rounding, not data.
RANK_SHARE = 1e-12
Floats = NDArray[np.float64]


class Split(NamedTuple):
    """The training rows of one fit, and its test rows by task key."""

    train: Rows
    tests: dict[str, Rows]


@dataclass(frozen=True, slots=True)
class PrincipalComponents:
    """Principal components of a training set.

    ``mean`` float64 (p,); ``axes`` float64 (p, k), columns by falling variance; ``variance``
    float64 (k,), divisor n − 1.
    """

    mean: Matrix
    axes: Matrix
    variance: Matrix

    def transform(self, features: Matrix) -> Matrix:
        """Return the scores of feature rows, float64 (n, k)."""
        projected: Matrix = features @ self.axes - self.mean @ self.axes
        return projected


@dataclass(frozen=True, slots=True)
class NestedLda:
    """Linear discriminants of all leading subsets of k_max coordinates.

    ``factor`` float64 (k_max, k_max), lower Cholesky factor of the pooled covariance;
    ``whitened_means`` float64 (k_max, n_classes); ``log_priors`` float64 (n_classes,);
    ``classes`` the labels as given; ``dropped`` coordinates (from 0) without within-class
    variance, which take no part.
    """

    classes: Labels
    factor: Matrix
    whitened_means: Matrix
    log_priors: Matrix
    dropped: tuple[int, ...]

    def predict(self, scores: Matrix) -> Labels:
        """Return the label of each row for each k: float64 (n, k_max) → (k_max, n), row k − 1."""
        white = _forward(self.factor, scores.T, self.dropped)
        total = np.tile(self.log_priors, (scores.shape[0], 1))
        winners = np.empty((scores.shape[1], scores.shape[0]), np.int64)
        for k in range(scores.shape[1]):
            mean = self.whitened_means[k]
            total += white[k][:, None] * mean - 0.5 * mean * mean
            winners[k] = total.argmax(axis=1)
        return self.classes[winners]


def fit_pca(features: Matrix, k_max: int) -> PrincipalComponents:
    """Return the exact leading principal components of features float64 (n, p).

    Raises :class:`WrongUse` for fewer than two rows or k_max beyond min(n − 1, p).
    """
    n, p = features.shape
    _check_components(n, p, k_max)
    mean = features.mean(axis=0)
    centred = features - mean
    if p <= n:
        return _from_covariance(mean, centred.T @ centred / (n - 1), k_max)
    return _from_rows(mean, centred, k_max)


def fit_nested_lda(scores: Matrix, labels: Labels) -> NestedLda:
    """Return the discriminants of all leading subsets of coordinates: scores float64 (n, k_max).

    The pooled covariance has the divisor n − classes. Raises :class:`WrongUse` for fewer than two
    classes, or no more rows than classes.
    """
    classes, index, counts = np.unique(labels, return_inverse=True, return_counts=True)
    n, n_classes = len(labels), len(classes)
    if n_classes < 2:
        raise WrongUse("a classifier needs training trials of at least two classes")
    if n <= n_classes:
        raise WrongUse(f"{n} training trials are too few for {n_classes} classes")
    means = np.zeros((n_classes, scores.shape[1]))
    np.add.at(means, index, scores)
    means /= counts[:, None]
    within = scores - means[index]
    factor, dropped = _factor(within.T @ within / (n - n_classes), scores.var(axis=0))
    whitened = _forward(factor, means.T, dropped)
    return NestedLda(classes, factor, whitened, np.log(counts / n), dropped)


def fit_fold_pcas(
    features: Matrix, training_rows: Sequence[Rows], k_max: int
) -> list[PrincipalComponents]:
    """Return the principal components of each fold's training rows: features float64 (n, p).

    Raises :class:`WrongUse` where a fold is too small for k_max or a feature is not finite.
    """
    if not np.isfinite(features).all():
        row = int(np.flatnonzero(~np.isfinite(features).all(axis=1))[0])
        raise WrongUse(f"the features of trial {row + 1} of the set are not all finite")
    smallest = min(map(len, training_rows))
    _check_components(smallest, features.shape[1], k_max)
    if features.shape[1] > smallest or len(training_rows) == 1:
        return [fit_pca(features[rows], k_max) for rows in training_rows]
    return _fold_pcas_by_difference(features, training_rows, k_max)


def _fold_pcas_by_difference(
    features: Matrix, training_rows: Sequence[Rows], k_max: int
) -> list[PrincipalComponents]:
    """Return each fold's components from the total scatter less that of its left-out rows."""
    offset = features.mean(axis=0)
    centred = features - offset
    left_out = [np.setdiff1d(np.arange(len(features)), rows) for rows in training_rows]
    total, scatters = _scatters(centred, left_out)
    total_sum, pcas = centred.sum(axis=0), []
    for rows, scatter in zip(left_out, scatters, strict=True):
        n = len(features) - len(rows)
        mean = (total_sum - centred[rows].sum(axis=0)) / n
        within = total - scatter - n * np.outer(mean, mean)
        pcas.append(_from_covariance(offset + mean, within / (n - 1), k_max))
    return pcas


def _scatters(centred: Matrix, left_out: Sequence[Rows]) -> tuple[Matrix, Iterable[Matrix]]:
    """Return the scatter of all rows, and of each fold's left-out rows, float64 (p, p) each.

    Where few folds leave out disjoint rows, the total is the sum of theirs and of the rest.
    """
    times = np.bincount(np.concatenate(left_out), minlength=len(centred))
    parts = (_scatter(centred[rows]) for rows in left_out)
    if len(left_out) > FOLDS_IN_MEMORY or times.max() > 1:
        return _scatter(centred), parts
    scatters = list(parts)
    return _scatter(centred[times == 0]) + sum(scatters), scatters


def _scatter(centred: Matrix) -> Matrix:
    product: Matrix = centred.T @ centred
    return product


def _from_covariance(mean: Matrix, covariance: Matrix, k_max: int) -> PrincipalComponents:
    variance, axes = _leading(covariance, k_max, np.ones(len(covariance)))
    return PrincipalComponents(mean, np.ascontiguousarray(axes), variance)


def _from_rows(mean: Matrix, centred: Matrix, k_max: int) -> PrincipalComponents:
    """Return the components of fewer rows than features, from the products of the rows.

    Their eigenvectors are the scores. The squares lose components that are too small beside the
    largest; where k_max includes such components, an SVD of the rows gives them.
    """
    n = len(centred)
    # A start of ones would fail: centred rows sum to zero.
    start = np.random.default_rng(0).normal(size=n)
    variance, scores = _leading(centred @ centred.T / (n - 1), k_max, start)
    if variance[-1] > FINE_SHARE * variance[0]:
        return PrincipalComponents(mean, centred.T @ scores / np.sqrt((n - 1) * variance), variance)
    _, s, rows = linalg.svd(centred, full_matrices=False, check_finite=False)
    return PrincipalComponents(mean, rows[:k_max].T, s[:k_max] ** 2 / (n - 1))


def _leading(symmetric: Matrix, k_max: int, start: Matrix) -> tuple[Matrix, Matrix]:
    """Return the leading eigenvalues (k_max,), falling, and eigenvectors (p, k_max), float64.

    Lanczos' method finds a few out of very many, to machine precision too; its fixed ``start``
    vector makes equal data give equal bits.
    """
    p = len(symmetric)
    if p >= LANCZOS_FEATURES and k_max <= p // LANCZOS_SHARE:
        from scipy.sparse.linalg import eigsh

        subspace = min(p, 2 * k_max + 20)
        found, unsorted = eigsh(symmetric, k=k_max, which="LA", v0=start, ncv=subspace, tol=0)
        order = np.argsort(found)
        values, vectors = found[order], unsorted[:, order]
    else:
        values, vectors = linalg.eigh(
            symmetric, subset_by_index=(p - k_max, p - 1), driver="evr", check_finite=False
        )
    return values[::-1], vectors[:, ::-1]


def _factor(covariance: Matrix, variance: Matrix) -> tuple[Matrix, tuple[int, ...]]:
    """Return the lower Cholesky factor; a coordinate without own variance becomes an empty row."""
    size = len(covariance)
    factor = np.zeros((size, size))
    dropped: list[int] = []
    for k in range(size):
        row = _forward(factor[:k, :k], covariance[:k, k], tuple(dropped))
        pivot = covariance[k, k] - row @ row
        if pivot <= NO_VARIANCE * variance[k]:
            dropped.append(k)
            continue
        factor[k, :k] = row
        factor[k, k] = np.sqrt(pivot)
    return factor, tuple(dropped)


def _forward(factor: Matrix, columns: Matrix, dropped: tuple[int, ...]) -> Matrix:
    """Solve factor · white = columns; dropped coordinates give 0."""
    solvable = factor.copy()
    right = columns.copy()
    for k in dropped:
        solvable[k, k] = 1.0
        right[k] = 0.0
    white: Matrix = linalg.solve_triangular(solvable, right, lower=True, check_finite=False)
    return white


def _check_components(n: int, p: int, k_max: int) -> None:
    if n < 2:
        raise WrongUse(f"{n} training trials are too few for principal components")
    most = min(n - 1, p)
    if not 1 <= k_max <= most:
        raise WrongUse(
            f"{k_max} principal components requested: {n} training trials with {p} features "
            f"allow 1 to {most}"
        )


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


def fit_classifier(features: Matrix, labels: Labels, components: int) -> ClassifierArrays:
    """Return the arrays of a model of ``components``, or of as many as are not rounding.

    Its mean, axes, variance, factor, whitened means, log priors and dropped components, as in
    :class:`rigctl.session.model_file.Classifier`.
    """
    pca = fit_pca(features, components)
    k = count_real_components(pca)
    lda = fit_nested_lda(pca.transform(features)[:, :k], labels)
    arrays = (pca.mean, pca.axes[:, :k], pca.variance[:k])
    discriminants = (lda.factor, lda.whitened_means, lda.log_priors)
    # Another memory order could change the last bit of a product after the file is read.
    mean, axes, variance, factor, means, priors = map(
        np.ascontiguousarray, (*arrays, *discriminants)
    )
    return mean, axes, variance, factor, means, priors, np.array(lda.dropped, np.int64)


def log_posteriors(model: Classifier, features: Floats) -> Floats:
    """Return the log posterior of each class: features float64 (n, p) → (n, classes)."""
    means = model.whitened_means
    constant = model.log_priors - 0.5 * (means * means).sum(axis=0)
    logs = np.empty((len(features), len(model.log_priors)))
    for row, white in enumerate(whiten(model, features)):
        logs[row] = white @ means + constant
    top = logs.max(axis=1, keepdims=True)
    normal: Floats = logs - top - np.log(np.exp(logs - top).sum(axis=1, keepdims=True))
    return normal


def whiten(model: Classifier, features: Floats) -> Floats:
    """Return the scores in units of the within-class spread, float64 (n, p) → (n, components)."""
    components = model.axes.shape[1]
    factor, used = model.factor.copy(), np.ones(components)
    # Components without within-class variance take no part.
    factor[model.dropped, model.dropped] = 1.0
    used[model.dropped] = 0.0
    offset = model.mean @ model.axes
    whitened = np.empty((len(features), components))
    # One row at a time: a matrix product may round a row differently beside other rows.
    for row, trial in enumerate(np.ascontiguousarray(features, np.float64)):
        scores = (trial @ model.axes - offset) * used
        whitened[row] = linalg.solve_triangular(factor, scores, lower=True, check_finite=False)
    return whitened
