"""The nested sweep against a scikit-learn fit for each number of components."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from sklearn.datasets import load_digits, load_iris, load_wine
from sklearn.decomposition import PCA
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.model_selection import StratifiedKFold

from rigctl.analysis.pca_lda import (
    ScaledCovariance,
    Split,
    SweepEngine,
    fit_nested_lda,
    fit_pca,
    predict_splits,
)
from rigctl.analysis.splits import Fold
from rigctl.errors import WrongUse


def predict_folds(features: Any, labels: Any, folds: list[Fold], k_max: int) -> list[Any]:
    splits = [Split(train, {"classes": test}) for train, test in folds]
    found = predict_splits(features, {"classes": labels}, splits, k_max, SweepEngine.OWN)
    return [one.predictions["classes"] for one in found]


def sklearn_predictions(features: Any, labels: Any, folds: list[Fold], k: int) -> list[Any]:
    results = []
    for train, test in folds:
        n, n_classes = len(train), len(np.unique(labels[train]))
        pca = PCA(k, svd_solver="full").fit(features[train])
        pooled = ScaledCovariance(n / (n - n_classes))
        lda = LinearDiscriminantAnalysis("lsqr", covariance_estimator=pooled)
        lda.fit(pca.transform(features[train]), labels[train])
        results.append(lda.predict(pca.transform(features[test])))
    return results


def folds_of(labels: Any, n_folds: int = 4) -> list[Fold]:
    splitter = StratifiedKFold(n_folds, shuffle=True, random_state=0)
    return list(splitter.split(np.zeros(len(labels)), labels))


def wide_set() -> tuple[Any, Any]:
    """More features than trials, classes of 24, 12 and 9."""
    rng = np.random.default_rng(3)
    labels = np.repeat([4, 7, 9], [24, 12, 9])
    return rng.normal(0, 1, (45, 120)) + rng.normal(0, 0.7, (10, 120))[labels], labels


def unequal_set() -> tuple[Any, Any]:
    """Correlated features far from zero, five classes of 20 to 140 trials."""
    rng = np.random.default_rng(8)
    labels = np.repeat(np.arange(5), [20, 50, 80, 110, 140])
    mix = rng.normal(0, 1, (60, 60)) * np.geomspace(10, 0.01, 60)
    return 500 + (rng.normal(0, 1, (400, 60)) + rng.normal(0, 0.6, (5, 60))[labels]) @ mix, labels


def broad_set() -> tuple[Any, Any]:
    """As many features as speed-scaled trials have, and more trials than features."""
    rng = np.random.default_rng(5)
    labels = np.repeat(np.arange(6), [240, 200, 160, 150, 130, 120])
    hidden = rng.normal(0, 1, (1000, 30)) + rng.normal(0, 0.5, (6, 30))[labels]
    return hidden @ rng.normal(0, 1, (30, 720)) + rng.normal(0, 2, (1000, 720)), labels


DATA_SETS = {
    "iris": (load_iris(return_X_y=True), 4),
    "wine, unequal classes": (load_wine(return_X_y=True), 13),
    "digits, constant columns": (load_digits(return_X_y=True), 40),
    "more features than trials": (wide_set(), 28),
    "unequal classes, far from zero": (unequal_set(), 50),
    "720 features": (broad_set(), 50),
}


@pytest.mark.parametrize("name", sorted(DATA_SETS))
def test_every_prediction_equals_that_of_scikit_learn(name: str) -> None:
    (features, labels), k_max = DATA_SETS[name]
    folds = folds_of(labels)
    ours = predict_folds(features, labels, folds, k_max)
    few = k_max < 15
    for k in range(1, k_max + 1) if few else (1, 5, k_max // 3, k_max):
        theirs = sklearn_predictions(features, labels, folds, k)
        for mine, other in zip(ours, theirs, strict=True):
            np.testing.assert_array_equal(mine[k - 1], other, err_msg=f"k = {k}")


def test_both_engines_agree_on_unequal_classes() -> None:
    features, labels = load_wine(return_X_y=True)
    splits = [Split(train, {"classes": test}) for train, test in folds_of(labels)]
    own, theirs = (
        predict_splits(features, {"classes": labels}, splits, 13, engine) for engine in SweepEngine
    )
    for one, other in zip(own, theirs, strict=True):
        np.testing.assert_array_equal(one.predictions["classes"], other.predictions["classes"])


@pytest.mark.parametrize("faintest", [1e-1, 1e-4, 1e-7])
@pytest.mark.parametrize("n", [60, 700])
def test_components_of_fewer_trials_than_features_are_those_of_an_svd(
    n: int, faintest: float
) -> None:
    rng = np.random.default_rng(n)
    left, _ = np.linalg.qr(rng.normal(size=(n, 40)))
    right, _ = np.linalg.qr(rng.normal(size=(n + 100, 40)))
    features = 5 + left * np.geomspace(1.0, faintest, 40) @ right.T
    found = fit_pca(features, 30)
    _, s, axes = np.linalg.svd(features - features.mean(axis=0), full_matrices=False)
    np.testing.assert_allclose(found.variance, s[:30] ** 2 / (n - 1), rtol=1e-9)
    np.testing.assert_allclose(np.abs(np.sum(found.axes * axes[:30].T, axis=0)), 1, atol=1e-12)
    np.testing.assert_allclose(found.axes.T @ found.axes, np.eye(30), atol=1e-9)


def test_folds_that_do_not_cover_the_set() -> None:
    """A training set smaller than the rest, as in the extrapolation task."""
    features, labels = unequal_set()
    train = np.flatnonzero(np.arange(400) % 4 == 0)
    test = np.flatnonzero(np.arange(400) % 4 == 1)
    folds = [(train, test)]
    ours = predict_folds(features, labels, folds, 20)[0]
    theirs = sklearn_predictions(features, labels, folds, 20)[0]
    np.testing.assert_array_equal(ours[19], theirs)


def test_a_coordinate_without_within_class_variance_is_set_aside() -> None:
    rng = np.random.default_rng(1)
    labels = np.repeat([0, 1], 20)
    scores = rng.normal(0, 1, (40, 4)) + labels[:, None]
    scores[:, 1] = labels
    scores[:, 3] = scores[:, 0] + scores[:, 2]
    lda = fit_nested_lda(scores, labels)
    assert lda.dropped == (1, 3)
    reduced = fit_nested_lda(scores[:, [0, 2]], labels)
    predictions = lda.predict(scores)
    np.testing.assert_array_equal(predictions[3], reduced.predict(scores[:, [0, 2]])[1])
    np.testing.assert_array_equal(predictions[1], predictions[0])


def test_components_are_ordered_and_orthonormal() -> None:
    for features, _ in (unequal_set(), wide_set()):
        principal = fit_pca(features, 20)
        assert (np.diff(principal.variance) <= 0).all()
        np.testing.assert_allclose(principal.axes.T @ principal.axes, np.eye(20), atol=1e-10)
        scores = principal.transform(features)
        np.testing.assert_allclose(scores.mean(axis=0), 0, atol=1e-9 * abs(features).max())
        np.testing.assert_allclose(scores.var(axis=0, ddof=1), principal.variance, rtol=1e-8)


def test_unsuitable_training_sets_are_refused_with_a_reason() -> None:
    features, labels = wide_set()
    with pytest.raises(WrongUse, match="allow 1 to 32"):
        predict_folds(features, labels, folds_of(labels), 40)
    with pytest.raises(WrongUse, match="two classes"):
        fit_nested_lda(features[:, :2], np.zeros(45, int))
    with pytest.raises(WrongUse, match="too few for 3 classes"):
        fit_nested_lda(features[[0, 24, 36], :2], labels[[0, 24, 36]])
    features[6, 5] = np.nan
    with pytest.raises(WrongUse, match="trial 7"):
        predict_folds(features, labels, folds_of(labels), 3)
