"""Spikes to features: SA rates and RA counts in windows of time or of texture travelled."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.encoding.encoder import encode_trials
from rigctl.encoding.normalisation import Normalisation
from rigctl.encoding.parameters import DEFAULT, EncoderParameters
from rigctl.encoding.speed_scaling import (
    REFERENCE_SPEED_MM_S,
    WINDOW_MS,
    window_begins,
    windows_of_samples,
)
from rigctl.errors import WrongUse
from rigctl.values import SAMPLE_RATE_HZ, Spikes


@dataclass(frozen=True, slots=True)
class FeatureLayout:
    """Which windows a feature vector has.

    ``scaled``: windows of texture travelled (``window_ms`` at the reference speed) instead of
    time. A vector holds train after train (SA taxel 1 … n, RA taxel 1 … n), each with
    ``n_windows`` values. What a trial has beyond the last window is dropped; windows that it does
    not reach are 0.
    """

    n_windows: int
    scaled: bool
    window_ms: int = WINDOW_MS
    reference_mm_s: float = REFERENCE_SPEED_MM_S

    def windows(self, n_samples: int, speed_mm_s: float) -> NDArray[np.int64]:
        """Window of each sample, int64 (n_samples,)."""
        return windows_of_samples(
            n_samples,
            self._speed(speed_mm_s),
            window_ms=self.window_ms,
            reference_mm_s=self.reference_mm_s,
        )

    def begins(self, speed_mm_s: float) -> NDArray[np.int64]:
        """First sample of each window and the first behind the last, int64 (n_windows + 1,)."""
        return window_begins(
            self.n_windows,
            self._speed(speed_mm_s),
            window_ms=self.window_ms,
            reference_mm_s=self.reference_mm_s,
        )

    def seconds(self, n_samples: int | Sequence[int], speed_mm_s: float) -> NDArray[np.float64]:
        """Real time that the samples of a trial spend in each window, float64 (n_windows,), s.

        Of several trials at that speed (n_trials, n_windows).
        """
        ends = np.asarray(n_samples, np.int64)[..., None]
        return np.diff(np.minimum(self.begins(speed_mm_s), ends)) / SAMPLE_RATE_HZ

    def _speed(self, speed_mm_s: float) -> float:
        return speed_mm_s if self.scaled else self.reference_mm_s

    def width(self, n_taxels: int) -> int:
        """Number of features."""
        return 2 * n_taxels * self.n_windows

    @classmethod
    def covering(
        cls, n_samples: Sequence[int], speeds_mm_s: Sequence[float], *, scaled: bool
    ) -> FeatureLayout:
        """As many windows as the longest trial of a set fills.

        Scaled, a stretch of less than half a window at the end is taken for clock error.
        """
        one = cls(1, scaled)
        ends = [0.0]
        for n, speed in zip(n_samples, speeds_mm_s, strict=True):
            factor = speed / one.reference_mm_s if scaled else 1.0
            ends.append(n * factor * 1000 / (SAMPLE_RATE_HZ * one.window_ms))
        longest = max(ends)
        return cls(max(1, round(longest) if scaled else int(np.ceil(longest))), scaled)


# The paper's two: 720 and 2160 features with 18 taxels.
SPEED_SCALED = FeatureLayout(20, scaled=True)
UNSCALED = FeatureLayout(60, scaled=False)


def trial_features(spikes: Spikes, speed_mm_s: float, layout: FeatureLayout) -> NDArray[np.float64]:
    """Feature vector of one trial, float64 (n_trains · n_windows,): SA in Hz, RA as counts.

    An SA value is the window's spikes over the real time that the trial spent in it, so that a
    slow trial reads the same rate as a fast one.
    """
    windows = layout.windows(spikes.n_samples, speed_mm_s)
    counts = np.zeros((spikes.n_trains, layout.n_windows))
    for row in range(spikes.n_trains):
        hit = windows[spikes.train(row)]
        counts[row] = np.bincount(hit[hit < layout.n_windows], minlength=layout.n_windows)
    return _rates_and_counts(counts, layout.seconds(spikes.n_samples, speed_mm_s))


def feature_matrices(
    trials: Sequence[NDArray[np.uint16]],
    speeds_mm_s: Sequence[float],
    normalisation: Normalisation,
    layouts: Sequence[FeatureLayout],
    parameters: EncoderParameters = DEFAULT,
    *,
    sa_scale: NDArray[np.float64] | None = None,
) -> list[NDArray[np.float64]]:
    """One feature matrix for each layout, float64 (n_trials, width), encoding every trial once.

    Equal to :func:`trial_features` of each trial's spikes. ``sa_scale`` as in
    :func:`rigctl.encoding.encoder.encode_trials`.
    """
    if len(trials) != len(speeds_mm_s):
        raise WrongUse(f"{len(trials)} trials, but {len(speeds_mm_s)} speeds")
    n_taxels = normalisation.n_taxels
    matrices = [np.zeros((len(trials), layout.width(n_taxels))) for layout in layouts]
    spikes = encode_trials(trials, normalisation, parameters, sa_scale=sa_scale)
    for index, (trains, speed) in enumerate(zip(spikes, speeds_mm_s, strict=True)):
        for layout, matrix in zip(layouts, matrices, strict=True):
            matrix[index] = trial_features(trains, speed, layout)
    return matrices


def _rates_and_counts(
    counts: NDArray[np.float64], seconds: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Counts (n_trains, n_windows) to the feature vector: the SA half becomes rates."""
    values = counts.copy()
    half = counts.shape[0] // 2
    np.divide(counts[:half], seconds, out=values[:half], where=seconds > 0)
    return values.reshape(-1)
