"""Benchmark Figure 3 and Table 1 of 24,000 trials against exact scikit-learn pipelines.

Both times are extrapolated: ours from one draw of all six tasks for each width, the peer's from one
pipeline for each width and training set. The note of the figure gives the factors.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.decomposition import PCA
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from threadpoolctl import threadpool_limits

from rigctl.analysis import published
from rigctl.analysis.pca_lda import Split, SweepEngine, predict_splits
from rigctl.analysis.splits import make_splits
from rigctl.analysis.trial_set import Design
from tests.benchmarks.encoder._peers import row

REPEATS, HIDDEN, MEASURED_K = 100, 60, 25
WIDTHS = {720: 2, 2160: 2}
"""Number of features, and how many of the four representations have that number."""
SOLVER = "covariance_eigh"
FAMILIES = ("folds", "extrapolation")


def measure() -> Iterator[dict[str, Any]]:
    """Yield one figure: four representations, six tasks, 1–50 components, 20 draws."""
    with threadpool_limits(1, "blas"):
        ours_s, theirs_s = 0.0, 0.0
        whole = design()
        for width, times in WIDTHS.items():
            features = generate_features(whole, width)
            for family in FAMILIES:
                fits = make_splits(whole, family, 0, 0)
                ours_s += published.ITERATIONS * times * _ours_s(features, whole, fits, family)
                theirs_s += published.ITERATIONS * times * _theirs_s(features, whole, fits, family)
    note = (
        "24,000 generated trials, 16 textures, widths 720 and 2160, one BLAS thread each; ours is "
        "one draw of each width x 2 representations x 20 draws; the peer is one fit at k = "
        f"{MEASURED_K} for each width and training set x 50 k x 4 folds x 2 label sets "
        "(extrapolation: x 50 k) x 2 representations x 20 draws"
    )
    peer = f"scikit-learn PCA({SOLVER}) + LDA, a pipeline for each k"
    yield row("fig3.vs_sklearn", ours_s, "s", peer, theirs_s, note)


def design() -> Design:
    """Return the design of the paper's 24,000 trials."""
    speeds, forces = (40.0, 60.0, 80.0, 100.0, 120.0), (250.0, 500.0, 1000.0)
    grid = np.meshgrid(np.arange(16), speeds, forces, np.arange(REPEATS), indexing="ij")
    texture, speed, force = (axis.ravel() for axis in grid[:3])
    return Design(tuple("ABCDEFGHIJKLMNOP"), texture.astype(np.int64), speed, force)


def generate_features(of: Design, width: int) -> NDArray[np.float64]:
    """Return features of textures that overlap in latent directions, float64 (24,000, width)."""
    rng = np.random.default_rng(width)
    hidden = rng.normal(0, 1, (len(of.texture), HIDDEN))
    hidden += 0.7 * rng.normal(0, 1, (16, HIDDEN))[of.texture]
    mix = rng.normal(0, 1, (HIDDEN, width)) * np.geomspace(1, 0.1, HIDDEN)[:, None]
    features: NDArray[np.float64] = rng.standard_normal((len(of.texture), width))
    features += hidden @ mix
    return features


def _ours_s(features: Any, of: Design, fits: list[Split], family: str) -> float:
    labels = {task.key: of.labels(task) for task in published.TASKS if task.family == family}
    start = time.perf_counter()
    predict_splits(features, labels, fits, published.K_MAX, SweepEngine.OWN)
    return time.perf_counter() - start


def _theirs_s(features: Any, of: Design, fits: list[Split], family: str) -> float:
    """Extrapolate one fit to all k and splits: one per k for textures, in folds also for groups."""
    train, tests = fits[0]
    tested = np.unique(np.concatenate(list(tests.values())))
    start = time.perf_counter()
    pca = PCA(MEASURED_K, svd_solver=SOLVER).fit(features[train])
    lda = LinearDiscriminantAnalysis(solver="lsqr")
    lda.fit(pca.transform(features[train]), of.texture[train])
    lda.predict(pca.transform(features[tested]))
    label_sets = 2 if family == "folds" else 1
    return published.K_MAX * len(fits) * label_sets * (time.perf_counter() - start)
