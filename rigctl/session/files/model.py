"""Trained classifier: everything from a trial's readings to its predicted class."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.encoding.features import FeatureLayout
from rigctl.encoding.force_matrix import ForceMatrix
from rigctl.encoding.normalisation import Normalisation
from rigctl.encoding.parameters import EncoderParameters
from rigctl.values import SAMPLE_RATE_HZ

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class TrainingInfo:
    """Source sessions and software of a model.

    ``inputs``: a mapping for each session; its ``content`` is the digest of the recording.
    ``seed`` is that of the analysis that made the model: training itself is not random.
    """

    made_utc: str
    software_version: str
    software_commit: str
    seed: int
    simulated: bool
    trials: int
    speeds_mm_s: tuple[float, ...]
    forces_g: tuple[float, ...]
    inputs: tuple[dict[str, Any], ...] = field(default=())


@dataclass(frozen=True, slots=True)
class Model:
    """Encoder, windows, principal components and discriminants of one representation.

    ``force``: how C scales the SA current: by the trial's own ``texture``, ``blind`` to it, or
    empty for no scaling; a scaling needs ``c``.
    ``mean`` float64 (p,), ``axes`` (p, k), ``variance`` (k,), divisor n − 1: principal components.
    ``factor`` (k, k), lower Cholesky factor of the pooled within-class covariance of the scores
    (divisor n − classes); ``whitened_means`` (k, classes); ``log_priors`` (classes,); ``dropped``
    int64, 0-based components that the classifier ignores. All arrays are in C order.
    """

    representation: str
    key: str
    force: str
    classes: tuple[str, ...]
    parameters: EncoderParameters
    normalisation: Normalisation
    features: FeatureLayout
    mean: Floats
    axes: Floats
    variance: Floats
    factor: Floats
    whitened_means: Floats
    log_priors: Floats
    dropped: NDArray[np.int64]
    c: ForceMatrix | None
    training: TrainingInfo
    sample_rate_hz: int = SAMPLE_RATE_HZ

    @property
    def n_taxels(self) -> int:
        """Number of taxels of a sample."""
        return self.normalisation.n_taxels

    @property
    def components(self) -> int:
        """Number of principal components of a prediction."""
        return int(self.axes.shape[1])
