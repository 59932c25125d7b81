"""What recordings of real skins show, measured on those of the simulated one."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.identification.sliding import Slides

MEAN_MS = 250
"""What a mean over so long leaves of a reading is its texture-made amplitude."""

RANGES = {
    "growth": (1.2, 2.5),
    "mean_scatter": (0.008, 0.03),
    "amplitude_scatter": (0.03, 0.07),
    "swing": (0.0, 0.09),
}
"""Within these a skin is like a skin; see docs/reference/world.md."""

_Floats = NDArray[np.float64]


class Measures(NamedTuple):
    """Figures of one set of trials.

    ``growth``: amplitude from the least to the greatest force; ``mean_growth``: of the mean;
    ``…_scatter``: from trial to trial of one condition, rms over the mean; ``…_shares``: of the
    variance that texture, speed and force explain. ``swing``: of the force at a set travel, rms,
    on the plate where it is worst; the rig's builders publish a force within 4.2 % rms over all.
    """

    growth: float
    mean_growth: float
    mean_scatter: float
    amplitude_scatter: float
    swing: float
    mean_shares: tuple[float, float, float]
    amplitude_shares: tuple[float, float, float]

    def lines(self) -> list[str]:
        """The figures for a person."""
        shares = [
            " / ".join(f"{share:.3f}" for share in some)
            for some in (self.mean_shares, self.amplitude_shares)
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
        """How far the figures lie outside of :data:`RANGES`, as shares of their bounds, summed."""
        outside = 0.0
        for name, (low, high) in RANGES.items():
            value = float(getattr(self, name))
            outside += max(0.0, low / value - 1.0, value / high - 1.0)
        return outside


def amplitude(samples: NDArray[np.uint16]) -> _Floats:
    """Rms of what a moving mean leaves of each reading, counts, float64 (n_taxels,)."""
    sums = np.cumsum(np.pad(samples.astype(np.float64), ((1, 0), (0, 0))), axis=0)
    means = (sums[MEAN_MS:] - sums[:-MEAN_MS]) / MEAN_MS
    middle = samples[MEAN_MS // 2 : MEAN_MS // 2 + len(means)]
    rms: _Floats = np.sqrt(np.mean((middle - means) ** 2, axis=0))
    return rms


def measure(slides: Slides) -> Measures:
    """All figures of one session with two repeats or more."""
    means = np.array([trial.mean(axis=0) for trial in slides.samples])
    amplitudes = np.array([amplitude(trial) for trial in slides.samples])
    design = slides.design
    conditions = design.conditions()
    factors = (design.texture, design.speed_mm_s, design.force_g)
    return Measures(
        _growth(amplitudes, design.force_g),
        _growth(means, design.force_g),
        _scatter(means, conditions),
        _scatter(amplitudes, conditions),
        slides.swing,
        _shares(means, factors),
        _shares(amplitudes, factors),
    )


def _growth(values: _Floats, force_g: _Floats) -> float:
    most, least = (values[force_g == force].mean() for force in (force_g.max(), force_g.min()))
    return float(most / least)


def _scatter(values: _Floats, conditions: list[NDArray[np.intp]]) -> float:
    """Rms over taxels and conditions of the spread over repeats, as a share of their mean."""
    spread = [values[rows].std(axis=0, ddof=1) / values[rows].mean(axis=0) for rows in conditions]
    return float(np.sqrt(np.mean(np.square(spread))))


def _shares(
    values: _Floats, factors: tuple[NDArray[np.generic], ...]
) -> tuple[float, float, float]:
    """Between-level over whole variance for each factor, summed over taxels."""
    whole = values.var(axis=0).sum()
    found = []
    for levels in factors:
        between = 0.0
        for level in np.unique(levels):
            rows = levels == level
            offset = values[rows].mean(axis=0) - values.mean(axis=0)
            between += float(np.mean(rows) * np.sum(offset**2))
        found.append(between / float(whole))
    return found[0], found[1], found[2]
