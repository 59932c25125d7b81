"""Benchmark the PCA+LDA sweep against scikit-learn: 8000 trials × 2160 features, 4 folds."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.datasets import load_digits, load_wine
from sklearn.decomposition import PCA
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from threadpoolctl import threadpool_limits

from rigctl.analysis.pca_lda import Split, SweepEngine, predict_splits
from rigctl.analysis.splits import Fold, stratified_folds
from tests.benchmarks.encoder._peers import row

N_TRIALS, N_FEATURES, N_CLASSES, K_MAX, N_FOLDS = 8000, 2160, 16, 50, 4
MEASURED_K, TURNS = 25, 3
SOLVER = "covariance_eigh"
SCENE = "8000 trials x 2160 features, 16 textures, 4 folds, k = 1..50; one BLAS thread each"

Data = tuple[NDArray[np.float64], NDArray[np.int64]]


def measure() -> Iterator[dict[str, Any]]:
    """Yield all figures of the sweep for k = 1 … 50."""
    with threadpool_limits(1, "blas"):
        yield from _measure()


def _measure() -> Iterator[dict[str, Any]]:
    features, labels = generate_set()
    folds = stratified_folds(labels, N_FOLDS, seed=0)
    candidates = (
        lambda: _predict(features, labels, folds, K_MAX, SweepEngine.OWN),
        lambda: _one_pipeline(features, labels, folds[0]),
        lambda: predict_hoisted(features, labels, folds, K_MAX),
    )
    (ours_s, one_s, hoisted_s), (ours, _, theirs) = run_in_turns(candidates)
    scene = f"{SCENE}; the median of {TURNS} runs in turns"
    note = f"{scene}; the peer's time is 200 times one fit at k = {MEASURED_K} in one fold"
    peer = f"scikit-learn PCA({SOLVER}) + LDA for each k and fold"
    yield row("sweep.vs_sklearn_exact", ours_s, "s", peer, N_FOLDS * K_MAX * one_s, note)
    peer = f"scikit-learn PCA({SOLVER}, 50) once a fold, LDA for each k"
    yield row("sweep.vs_sklearn_hoisted", ours_s, "s", peer, hoisted_s, scene)
    yield _differing(_count_differing(ours, theirs), sum(t.size for t in theirs))


def run_in_turns(candidates: Sequence[Callable[[], Any]]) -> tuple[list[float], list[Any]]:
    """Return the median wall time of each, s, and its last result; load affects all alike."""
    spent: list[list[float]] = [[] for _ in candidates]
    for _ in range(TURNS):
        results = []
        for times, candidate in zip(spent, candidates, strict=True):
            start = time.perf_counter()
            results.append(candidate())
            times.append(time.perf_counter() - start)
    return list(map(statistics.median, spent)), results


def generate_set() -> Data:
    """Return classes that overlap in sixty latent directions of decreasing weight."""
    rng = np.random.default_rng(0)
    labels = np.repeat(np.arange(N_CLASSES), N_TRIALS // N_CLASSES)
    hidden = 3 * rng.normal(0, 1, (N_TRIALS, 60))
    hidden += 0.6 * rng.normal(0, 1, (N_CLASSES, 60))[labels]
    mix = rng.normal(0, 1, (60, N_FEATURES)) * np.geomspace(1, 0.1, N_FEATURES)
    return hidden @ mix + rng.normal(0, 5, (N_TRIALS, N_FEATURES)), labels


def _predict(
    features: NDArray[np.float64],
    labels: NDArray[np.int64],
    folds: list[Fold],
    k_max: int,
    engine: SweepEngine,
) -> list[NDArray[np.int64]]:
    splits = [Split(train, {"classes": test}) for train, test in folds]
    found = predict_splits(features, {"classes": labels}, splits, k_max, engine)
    return [one.predictions["classes"] for one in found]


def predict_hoisted(
    features: NDArray[np.float64], labels: NDArray[np.int64], folds: list[Fold], k_max: int
) -> list[NDArray[np.int64]]:
    """Return scikit-learn's predictions (k_max, n_test) of each fold, with one PCA for all k.

    Its LDA divides the covariance by N, not by N − K, which changes nothing for equal classes.
    """
    results = []
    for train, test in folds:
        pca = PCA(k_max, svd_solver=SOLVER).fit(features[train])
        trained, tested = pca.transform(features[train]), pca.transform(features[test])
        lda = LinearDiscriminantAnalysis("lsqr")
        fits = (lda.fit(trained[:, :k], labels[train]) for k in range(1, k_max + 1))
        results.append(
            np.array([fit.predict(tested[:, :k]) for k, fit in enumerate(fits, start=1)])
        )
    return results


def _one_pipeline(features: Any, labels: Any, fold: Fold) -> None:
    train, test = fold
    pca = PCA(MEASURED_K, svd_solver=SOLVER).fit(features[train])
    lda = LinearDiscriminantAnalysis("lsqr").fit(pca.transform(features[train]), labels[train])
    lda.predict(pca.transform(features[test]))


def _differing(big: int, n_big: int) -> dict[str, Any]:
    """Add two published sets, one with unequal classes and one with constant columns."""
    differing, compared = big, n_big
    for loader, k_max in ((load_wine, 13), (load_digits, 40)):
        features, labels = loader(return_X_y=True)
        folds = stratified_folds(labels, N_FOLDS, seed=0)
        ours, theirs = (_predict(features, labels, folds, k_max, e) for e in SweepEngine)
        differing += _count_differing(ours, theirs)
        compared += sum(t.size for t in theirs)
    note = f"of {compared} predictions, every trial and every k, in three data sets"
    return row("sweep.differing_predictions", differing, "predictions", "scikit-learn", 0, note)


def _count_differing(ours: list[NDArray[np.int64]], theirs: list[NDArray[np.int64]]) -> int:
    return sum(int((a != b).sum()) for a, b in zip(ours, theirs, strict=True))
