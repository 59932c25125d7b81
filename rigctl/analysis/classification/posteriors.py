"""A model asked: features to posteriors, each trial by itself, whatever stands beside it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from rigctl.session.files.model import Model

Floats = NDArray[np.float64]


def log_posteriors(model: Model, features: Floats) -> Floats:
    """ln of the posterior of each class: features float64 (n, p) → (n, classes)."""
    factor, kept = _solvable(model)
    offset = model.mean @ model.axes
    means = model.whitened_means
    constant = model.log_priors - 0.5 * (means * means).sum(axis=0)
    answers = np.empty((len(features), len(model.classes)))
    # One row at a time: a product of matrices may round a row otherwise with other rows beside it.
    for row, trial in enumerate(np.ascontiguousarray(features, np.float64)):
        scores = (trial @ model.axes - offset) * kept
        white = linalg.solve_triangular(factor, scores, lower=True, check_finite=False)
        answers[row] = white @ means + constant
    top = answers.max(axis=1, keepdims=True)
    normal: Floats = answers - top - np.log(np.exp(answers - top).sum(axis=1, keepdims=True))
    return normal


def _solvable(model: Model) -> tuple[Floats, Floats]:
    """The factor with ones for the components that take no part, and 0 or 1 for each component."""
    factor, kept = model.factor.copy(), np.ones(model.components)
    factor[model.dropped, model.dropped] = 1.0
    kept[model.dropped] = 0.0
    return factor, kept
