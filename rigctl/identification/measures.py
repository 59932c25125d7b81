"""Measure on simulated recordings what recordings of real skins show."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.identification.sliding import SlideSession

MEAN_MS = 250
"""A reading minus its moving mean over this time is the signal of the texture."""

RANGES = {
    "growth": (1.2, 2.5),
    "mean_scatter": (0.008, 0.03),
    "amplitude_scatter": (0.03, 0.07),
    "swing": (0.0, 0.09),
}
"""Ranges of real skins; see docs/reference/world.md."""

_Floats = NDArray[np.float64]


class SkinMeasures(NamedTuple):
    """Figures of one set of trials.

    ``growth`` and ``mean_growth``: ratio of amplitude and mean at the highest force to those at the
    lowest; ``…_scatter``: from trial to trial of one condition, rms over the mean; ``…_shares``:
    variance explained by texture, speed and force. ``swing``: relative rms of the force at a set
    travel on the worst plate; the rig's builders publish a force within 4.2 % rms over all plates.
    """

    growth: float
    mean_growth: float
    mean_scatter: float
    amplitude_scatter: float
    swing: float
    mean_shares: tuple[float, float, float]
    amplitude_shares: tuple[float, float, float]

    def lines(self) -> list[str]:
        """Format the figures."""
        shares = [
            " / ".join(f"{share:.3f}" for share in shares_of)
            for shares_of in (self.mean_shares, self.amplitude_shares)
        ]
        return [
            f"from the least to the greatest force: amplitude × {self.growth:.2f}, "
            f"mean × {self.mean_growth:.2f}",
            f"from trial to trial: mean {self.mean_scatter:.1%}, "
            f"amplitude {self.amplitude_scatter:.1%}",
            f"force at a set travel, on the worst plate: {self.swing:.1%} rms",
            f"variance of the mean by texture / speed / force: {shares[0]}",
            f"variance of the amplitude by texture / speed / force: {shares[1]}",
        ]

    @property
    def excess(self) -> float:
        """Sum of the figures' distances from :data:`RANGES`, relative to the bounds."""
        outside = 0.0
        for name, (low, high) in RANGES.items():
            value = float(getattr(self, name))
            outside += max(0.0, low / value - 1.0, value / high - 1.0)
        return outside


def amplitude(samples: NDArray[np.uint16]) -> _Floats:
    """Return the rms of each reading minus its moving mean, counts, float64 (n_taxels,)."""
    sums = np.cumsum(np.pad(samples.astype(np.float64), ((1, 0), (0, 0))), axis=0)
    means = (sums[MEAN_MS:] - sums[:-MEAN_MS]) / MEAN_MS
    middle = samples[MEAN_MS // 2 : MEAN_MS // 2 + len(means)]
    rms: _Floats = np.sqrt(np.mean((middle - means) ** 2, axis=0))
    return rms


def measure_skin(slides: SlideSession) -> SkinMeasures:
    """Compute all figures of one session with two or more repeats."""
    means = np.array([trial.mean(axis=0) for trial in slides.samples])
    amplitudes = np.array([amplitude(trial) for trial in slides.samples])
    design = slides.design
    conditions = design.conditions()
    factors = (design.texture, design.speed_mm_s, design.force_g)
    return SkinMeasures(
        _growth(amplitudes, design.force_g),
        _growth(means, design.force_g),
        _scatter(means, conditions),
        _scatter(amplitudes, conditions),
        slides.swing,
        _shares(means, factors),
        _shares(amplitudes, factors),
    )


def _growth(values: _Floats, force_g: _Floats) -> float:
    high, low = (values[force_g == force].mean() for force in (force_g.max(), force_g.min()))
    return float(high / low)


def _scatter(values: _Floats, conditions: list[NDArray[np.intp]]) -> float:
    """Return the rms over taxels and conditions of the relative spread over repeats."""
    spread = [values[rows].std(axis=0, ddof=1) / values[rows].mean(axis=0) for rows in conditions]
    return float(np.sqrt(np.mean(np.square(spread))))


def _shares(
    values: _Floats, factors: tuple[NDArray[np.generic], ...]
) -> tuple[float, float, float]:
    """Return between-level over total variance for each factor, summed over taxels."""
    total = values.var(axis=0).sum()
    found = []
    for levels in factors:
        between = 0.0
        for level in np.unique(levels):
            rows = levels == level
            offset = values[rows].mean(axis=0) - values.mean(axis=0)
            between += float(np.mean(rows) * np.sum(offset**2))
        found.append(between / float(total))
    return found[0], found[1], found[2]
