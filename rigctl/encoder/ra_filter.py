"""The RA channel's signals of a whole trial: the low-passed reading, its derivative, the current.

The kernel filters sample by sample and knows one filter. This module knows every one that
:class:`rigctl.encoder.parameters.RaFilter` names, also those that look ahead, and serves figures.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, signal

from rigctl.encoder.parameters import EncoderParameters, RaDerivative, RaFilter, Rectify

Floats = NDArray[np.float64]

STOP_BAND_DB = 60.0
STEEPNESS = 0.85
"""Attenuation and steepness that MATLAB's ``lowpass`` has by default."""


class RaSignals(NamedTuple):
    """Signals of a trial, float64 (n, n_taxels) each.

    ``low_passed``: the normalised reading behind the filter. ``derivative``: its change, rectified
    if the parameters say so, per second or per sample. ``current``: that times the gain, mV/ms.
    """

    low_passed: Floats
    derivative: Floats
    current: Floats


def ra_signals(x: Floats, parameters: EncoderParameters) -> RaSignals:
    """Return the RA channel's signals of normalised readings, float64 (n, n_taxels)."""
    low_passed = low_pass(x, parameters)
    change = np.diff(low_passed, axis=0, prepend=low_passed[:1])
    if parameters.ra_rectify is Rectify.ABSOLUTE:
        change = np.abs(change)
    elif parameters.ra_rectify is Rectify.RISING_ONLY:
        change = np.maximum(change, 0.0)
    per_sample = parameters.ra_derivative is RaDerivative.PER_SAMPLE
    derivative = change if per_sample else change * parameters.sample_rate_hz
    return RaSignals(low_passed, derivative, parameters.ra_change_gain * change)


def low_pass(x: Floats, parameters: EncoderParameters) -> Floats:
    """Return normalised readings behind the low-pass, float64 (n, n_taxels).

    The causal filter starts in the steady state of the first sample. The others see the trial's
    first and last readings continued: mirrored at the end point (zero-phase), or held
    (linear-phase).
    """
    if not len(x):
        return x
    p, smooth = parameters, np.empty_like(x)
    if p.ra_filter is RaFilter.LINEAR_PHASE:
        taps = linear_phase_taps(p.ra_lowpass_hz, p.sample_rate_hz)
        ndimage.correlate1d(x, taps, axis=0, output=smooth, mode="nearest")
        return smooth
    sections = _butterworth_sections(p.ra_order, p.ra_lowpass_hz, p.sample_rate_hz)
    if p.ra_filter is RaFilter.ZERO_PHASE:
        reach = min(len(x) - 1, 3 * (p.ra_order + 1))
        smooth[:] = signal.sosfiltfilt(sections, x, axis=0, padlen=reach)
    else:
        start = signal.sosfilt_zi(sections)[:, :, None] * x[0]
        smooth[:], _ = signal.sosfilt(sections, x, axis=0, zi=start)
    return smooth


@cache
def _butterworth_sections(order: int, cutoff_hz: float, rate_hz: float) -> Floats:
    sections: Floats = signal.butter(order, cutoff_hz, fs=rate_hz, output="sos")
    return sections


@cache
def linear_phase_taps(pass_hz: float, rate_hz: float) -> Floats:
    """Return the coefficients of the linear-phase low-pass, float64, odd in number, sum 1.

    Kaiser's window with the attenuation and the transition of MATLAB's ``lowpass``: from the pass
    frequency over 15 % of the rest up to half the sample rate, 60 dB down.
    """
    nyquist_hz = rate_hz / 2
    width_hz = (1.0 - STEEPNESS) * (nyquist_hz - pass_hz)
    n, beta = signal.kaiserord(STOP_BAND_DB, width_hz / nyquist_hz)
    window = ("kaiser", beta)
    taps: Floats = signal.firwin(n | 1, pass_hz + width_hz / 2, window=window, fs=rate_hz)
    return taps
