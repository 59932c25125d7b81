"""Slow smooth fluctuations, such as those of a person's speed and force."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

_STEP_S = 0.02
_REACH = 4.0


def wander(n: int, correlation_s: float, random: np.random.Generator) -> NDArray[np.float64]:
    """Return a stationary Gaussian process of unit variance, one value a millisecond, float64 (n,).

    Its correlation falls to exp(-1/4) in ``correlation_s``: white noise under a Gaussian window.
    Unlike a first-order process it has a finite rate of change, as a moving limb has.
    """
    sigma = correlation_s / _STEP_S
    margin = int(np.ceil(_REACH * sigma))
    points = int(n * 1e-3 / _STEP_S) + 2
    noise = random.standard_normal(points + 2 * margin)
    smooth = gaussian_filter1d(noise, sigma, truncate=_REACH)[margin : margin + points]
    smooth *= np.sqrt(2.0 * np.sqrt(np.pi) * sigma)
    values: NDArray[np.float64] = np.interp(
        np.arange(n) * 1e-3, np.arange(points) * _STEP_S, smooth
    )
    return values
