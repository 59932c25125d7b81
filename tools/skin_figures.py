"""How textures, speeds, presses and repeats move the readings of a skin, real or simulated."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.trial_set import Design
from tools.slides import SlideSession

Floats = NDArray[np.float64]
MEAN_MS = 250
"""A reading minus its moving mean over this time is the signal of the texture."""

RANGES = {
    "growth": (1.2, 2.5),
    "mean_scatter": (0.008, 0.03),
    "amplitude_scatter": (0.03, 0.07),
    "swing": (0.0, 0.09),
}
"""Ranges of real skins; see docs/reference/world.md."""


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
            outside += _outside(float(getattr(self, name)), low, high)
        return outside


def amplitude(samples: NDArray[Any]) -> Floats:
    """Return the rms of each reading minus its moving mean, float64 (n_taxels,)."""
    sums = np.cumsum(np.pad(samples.astype(np.float64), ((1, 0), (0, 0))), axis=0)
    means = (sums[MEAN_MS:] - sums[:-MEAN_MS]) / MEAN_MS
    middle = samples[MEAN_MS // 2 : MEAN_MS // 2 + len(means)]
    rms: Floats = np.sqrt(np.mean((middle - means) ** 2, axis=0))
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


def _growth(values: Floats, force_g: Floats) -> float:
    high, low = (values[force_g == force].mean() for force in (force_g.max(), force_g.min()))
    return float(high / low)


def _scatter(values: Floats, conditions: list[NDArray[np.intp]]) -> float:
    """Return the rms over taxels and conditions of the relative spread over repeats."""
    spread = [values[rows].std(axis=0, ddof=1) / values[rows].mean(axis=0) for rows in conditions]
    return float(np.sqrt(np.mean(np.square(spread))))


def _shares(values: Floats, factors: tuple[NDArray[np.generic], ...]) -> tuple[float, float, float]:
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


DEPTH_RANGES = {
    "textures": (0.05, 0.1),
    "over_within": (0.6, 0.8),
    "over_speeds": (4.0, math.inf),
}
DEPTH_GROWTHS = {"mean_growth": (1.1, 1.5), "amplitude_growth": (1.2, 1.5)}
"""Ranges of real skins at set depths; see docs/explanation/real-and-simulated.md."""


def _outside(value: float, low: float, high: float) -> float:
    """Return the distance from a range, relative to its bound."""
    return max(0.0, low / value - 1.0, value / high - 1.0)


class LevelFigures(NamedTuple):
    """Standard deviations at one press, as shares of a taxel's range, means over the taxels.

    ``textures``, ``speeds``, ``repeats``: of a trial's mean reading, between textures, between the
    speeds of a texture, and between the repeats of a condition (NaN without repeats). ``within``:
    of a reading within a trial, rms over the trials.
    """

    press: float
    textures: float
    speeds: float
    repeats: float
    within: float

    @property
    def over_within(self) -> float:
        """Deviation between textures over that within a trial."""
        return self.textures / self.within

    @property
    def over_speeds(self) -> float:
        """Deviation between textures over that between speeds."""
        return self.textures / self.speeds


class SkinFigures(NamedTuple):
    """Figures of one set; growth of mean and amplitude is from the least to the greatest press."""

    levels: tuple[LevelFigures, ...]
    mean_growth: float
    amplitude_growth: float

    @property
    def cells(self) -> tuple[str, ...]:
        """The figures as the last cells of a table's row."""
        between = [_span([level[i] for level in self.levels], 3) for i in (1, 2, 3)]
        ratio = _span([level.over_within for level in self.levels], 2)
        growths = f"× {self.mean_growth:.2f}", f"× {self.amplitude_growth:.2f}"
        return *between, ratio, *growths

    @property
    def depth_excess(self) -> float:
        """Sum of the distances from the ranges at set depths, means over the depths."""
        outside = [
            _outside(getattr(level, name), *bounds) / len(self.levels)
            for level in self.levels
            for name, bounds in DEPTH_RANGES.items()
        ]
        outside += [_outside(getattr(self, name), *ends) for name, ends in DEPTH_GROWTHS.items()]
        return sum(outside)


def _span(values: Sequence[float], digits: int) -> str:
    """Format values as the least and the greatest, "–" where one is unknown."""
    if not np.all(np.isfinite(values)):
        return "–"
    return "–".join(dict.fromkeys(f"{end:.{digits}f}" for end in (min(values), max(values))))


def skin_figures(samples: Sequence[NDArray[Any]], design: Design) -> SkinFigures:
    """Compute the figures of a set of trials, (n, n_taxels) each."""
    low, high = (
        np.min([trial.min(axis=0) for trial in samples], axis=0),
        np.max([trial.max(axis=0) for trial in samples], axis=0),
    )
    span = np.maximum(high.astype(float) - low, 1e-9)
    means = np.array([trial.mean(axis=0) for trial in samples])
    spreads = np.array([trial.std(axis=0) for trial in samples])
    amplitudes = np.array([amplitude(trial) for trial in samples])
    presses = np.unique(design.force_g)
    levels = [_level_figures(press, means / span, spreads / span, design) for press in presses]
    least, most = (design.force_g == end for end in (presses[0], presses[-1]))
    growths = (float(one[most].mean() / one[least].mean()) for one in (means, amplitudes))
    return SkinFigures(tuple(levels), *growths)


def _level_figures(press: float, means: Floats, spreads: Floats, design: Design) -> LevelFigures:
    rows = np.flatnonzero(design.force_g == press)
    means, texture, speed = means[rows], design.texture[rows], design.speed_mm_s[rows]
    names = np.unique(texture)
    speeds = [_group_means(means[texture == name], speed[texture == name]) for name in names]
    repeats = [means[(texture == name) & (speed == v)] for name in names for v in np.unique(speed)]
    return LevelFigures(
        float(press),
        _spread([_group_means(means, texture)]),
        _spread(speeds),
        _spread(repeats),
        float(np.sqrt(np.mean(np.square(spreads[rows]), axis=0)).mean()),
    )


def _group_means(values: Floats, labels: NDArray[Any]) -> Floats:
    return np.array([values[labels == label].mean(axis=0) for label in np.unique(labels)])


def _spread(groups: Sequence[Floats]) -> float:
    """Return the rms over groups of each column's standard deviation, as the mean of columns."""
    several = [group.var(axis=0, ddof=1) for group in groups if len(group) > 1]
    return float(np.sqrt(np.mean(several, axis=0)).mean()) if several else float("nan")
