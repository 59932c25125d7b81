"""Compute features from spikes: SA rates and RA counts in windows of time or of texture travelled.

Speed-scaled windows measure time in texture travelled, so that a spike's window is a place on the
texture.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rigctl.encoder.encoder import encode_trials
from rigctl.encoder.force_gain import ForceGain
from rigctl.encoder.normalisation import Normalisation
from rigctl.encoder.parameters import DEFAULT, EncoderParameters
from rigctl.errors import WrongUse
from rigctl.values import SAMPLE_RATE_HZ, Spikes

REFERENCE_SPEED_MM_S = 120.0
WINDOW_MS = 100
UM_PER_MM = 1000


@dataclass(frozen=True, slots=True)
class FeatureLayout:
    """Windows of a feature vector.

    A window is ``window_ms`` of time or, if ``scaled``, the texture that passes in ``window_ms`` at
    the reference speed. A vector holds train after train (SA taxel 1 … n, RA taxel 1 … n), each
    with ``n_windows`` values. Samples beyond the last window are dropped; windows that a trial does
    not reach are 0.
    """

    n_windows: int
    scaled: bool
    window_ms: int = WINDOW_MS
    reference_mm_s: float = REFERENCE_SPEED_MM_S

    def sample_windows(self, n_samples: int, speed_mm_s: float) -> NDArray[np.int64]:
        """Return the window of each sample of a trial, int64 (n_samples,), ascending from 0.

        In integers (t·v) // (window · reference), which is (t·v) // 12000 for the paper's numbers:
        floating-point bins would put some samples on the wrong side. Speeds are rounded to µm/s.
        Raises :class:`WrongUse` for a speed not above 0, or a window without a sample.
        """
        speed, window = self._step_and_window(speed_mm_s)
        return np.arange(n_samples, dtype=np.int64) * speed // window

    def window_starts(self, speed_mm_s: float) -> NDArray[np.int64]:
        """Return the first sample of each window and the end of the last, int64 (n_windows + 1,).

        A window that is too short for a sample starts where the next one does. Raises as
        :meth:`sample_windows`.
        """
        speed, window = self._step_and_window(speed_mm_s)
        return -(-np.arange(self.n_windows + 1, dtype=np.int64) * window // speed)

    def window_durations_s(
        self, n_samples: int | Sequence[int], speed_mm_s: float
    ) -> NDArray[np.float64]:
        """Return the real time that a trial spends in each window, float64 (n_windows,), s.

        For several trials at that speed (n_trials, n_windows).
        """
        ends = np.asarray(n_samples, np.int64)[..., None]
        return np.diff(np.minimum(self.window_starts(speed_mm_s), ends)) / SAMPLE_RATE_HZ

    def n_features(self, n_taxels: int) -> int:
        """Return the number of features."""
        return 2 * n_taxels * self.n_windows

    def _step_and_window(self, speed_mm_s: float) -> tuple[int, int]:
        """Return the travel of one sample and the length of a window in the same integer unit."""
        reference = round(self.reference_mm_s * UM_PER_MM)
        speed = round(speed_mm_s * UM_PER_MM) if self.scaled else reference
        if speed <= 0 or reference <= 0:
            raise WrongUse(f"speed scaling needs speeds above 0, not {speed_mm_s:g} mm/s")
        window_samples = self.window_ms * SAMPLE_RATE_HZ // 1000
        if window_samples <= 0:
            raise WrongUse(f"a feature window of {self.window_ms} ms holds no sample")
        return speed, window_samples * reference

    @classmethod
    def covering(
        cls,
        n_samples: Sequence[int],
        speeds_mm_s: Sequence[float],
        *,
        scaled: bool,
        window_ms: int = WINDOW_MS,
        reference_mm_s: float = REFERENCE_SPEED_MM_S,
    ) -> FeatureLayout:
        """Return a layout with as many windows as the longest trial of a set fills.

        Less than half a window at the end counts as clock error: 6,001 samples, both ends of 6 s
        included, fill the paper's 60 windows.
        """
        one = cls(1, scaled, window_ms, reference_mm_s)
        ends = [0.0]
        for n, speed in zip(n_samples, speeds_mm_s, strict=True):
            factor = speed / one.reference_mm_s if scaled else 1.0
            ends.append(n * factor * 1000 / (SAMPLE_RATE_HZ * one.window_ms))
        return replace(one, n_windows=max(1, int(max(ends) + 0.5)))


# The paper's two: 720 and 2160 features with 18 taxels.
SPEED_SCALED = FeatureLayout(20, scaled=True)
UNSCALED = FeatureLayout(60, scaled=False)


def trial_features(spikes: Spikes, speed_mm_s: float, layout: FeatureLayout) -> NDArray[np.float64]:
    """Return the feature vector of one trial, float64 (n_trains · n_windows,): SA in Hz, RA counts.

    An SA value is the window's spikes over the real time that the trial spent in it, so that slow
    and fast trials give the same rate.
    """
    windows = layout.sample_windows(spikes.n_samples, speed_mm_s)
    values = np.zeros((spikes.n_trains, layout.n_windows))
    for row in range(spikes.n_trains):
        hits = windows[spikes.train(row)]
        values[row] = np.bincount(hits[hits < layout.n_windows], minlength=layout.n_windows)
    sa = values[: spikes.n_trains // 2]
    durations_s = layout.window_durations_s(spikes.n_samples, speed_mm_s)
    np.divide(sa, durations_s, out=sa, where=durations_s > 0)
    return values.reshape(-1)


def feature_matrices(
    trials: Sequence[NDArray[np.uint16]],
    speeds_mm_s: Sequence[float],
    normalisation: Normalisation,
    layouts: Sequence[FeatureLayout],
    parameters: EncoderParameters = DEFAULT,
    *,
    sa_scale: NDArray[np.float64] | None = None,
    gains: Sequence[ForceGain] = (),
) -> list[NDArray[np.float64]]:
    """Return one feature matrix for each layout, float64 (n_trials, n_features).

    Encodes every trial once. Equal to :func:`trial_features` of each trial's spikes. ``sa_scale``
    and ``gains`` as in :func:`rigctl.encoder.encoder.encode_trials`.
    """
    if len(trials) != len(speeds_mm_s):
        raise WrongUse(f"{len(trials)} trials, but {len(speeds_mm_s)} speeds")
    n_taxels = normalisation.n_taxels
    matrices = [np.zeros((len(trials), layout.n_features(n_taxels))) for layout in layouts]
    spikes = encode_trials(trials, normalisation, parameters, sa_scale=sa_scale, gains=gains)
    for index, (trains, speed) in enumerate(zip(spikes, speeds_mm_s, strict=True)):
        for layout, matrix in zip(layouts, matrices, strict=True):
            matrix[index] = trial_features(trains, speed, layout)
    return matrices
