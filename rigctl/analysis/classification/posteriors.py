"""Log posteriors of a trained PCA and LDA; a row's bits do not depend on the rows beside it."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

Floats = NDArray[np.float64]


class TrainedClassifier(Protocol):
    """Principal components and discriminants, as :class:`rigctl.session.model_file.Model`."""

    @property
    def mean(self) -> Floats: ...
    @property
    def axes(self) -> Floats: ...
    @property
    def factor(self) -> Floats: ...
    @property
    def whitened_means(self) -> Floats: ...
    @property
    def log_priors(self) -> Floats: ...
    @property
    def dropped(self) -> NDArray[np.int64]: ...


def log_posteriors(model: TrainedClassifier, features: Floats) -> Floats:
    """Return the log posterior of each class: features float64 (n, p) → (n, classes)."""
    means = model.whitened_means
    constant = model.log_priors - 0.5 * (means * means).sum(axis=0)
    logs = np.empty((len(features), len(model.log_priors)))
    for row, white in enumerate(whiten(model, features)):
        logs[row] = white @ means + constant
    top = logs.max(axis=1, keepdims=True)
    normal: Floats = logs - top - np.log(np.exp(logs - top).sum(axis=1, keepdims=True))
    return normal


def whiten(model: TrainedClassifier, features: Floats) -> Floats:
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
