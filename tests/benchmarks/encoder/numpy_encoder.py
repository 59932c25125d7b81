"""The default encoder in optimised NumPy: the peer that needs no compiler.

All neurons of all trials advance together, in place.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from rigctl.encoder.kernel import butterworth
from rigctl.encoder.parameters import DEFAULT, EncoderParameters

Reals = NDArray[np.float64]
HIGHEST = 1023.0


def currents(samples: NDArray[np.uint16], p: EncoderParameters) -> Reals:
    """Return k·x of one trial, filtered by SciPy, float64 (n, 36): SA, then RA."""
    x = samples / HIGHEST
    b, a = butterworth(p.ra_lowpass_hz, p.sample_rate_hz)
    smooth, _ = signal.lfilter(b, a, x, axis=0, zi=signal.lfilter_zi(b, a)[:, None] * x[0])
    slope = np.diff(smooth, axis=0, prepend=smooth[:1]) * p.sample_rate_hz
    return np.hstack([p.sa_gain * x, p.ra_gain * slope])


def numpy_spikes(drive: Reals) -> NDArray[np.uint8]:
    """Return the spike counts (n, m) of input currents (n, m)."""
    neurons = _Neurons(drive.shape[1])
    counts = np.zeros(drive.shape, np.uint8)
    for now, spikes in zip(drive, counts, strict=True):
        neurons.advance(now, spikes)
    return counts


def numpy_trains(readings: NDArray[np.uint16]) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """Return the spike trains of readings of all lanes, uint16 (n, m): SA of all lanes, then RA.

    The result is the start of each train, int64 (2·m + 1,), and the samples of all spikes, int32.
    """
    n, m = readings.shape
    if 2 * m > np.iinfo(np.uint16).max:
        raise ValueError(f"{2 * m} trains do not fit in 16-bit numbers")
    drives, neurons = _Drives(readings[0]), _Neurons(2 * m)
    which, sizes = [], np.empty(n, np.int64)
    for t in range(n):
        spikes = np.zeros(2 * m, np.uint8)
        neurons.advance(drives.advance(readings[t]), spikes)
        some = np.flatnonzero(spikes.view(np.bool_))
        which.append(np.repeat(some, spikes[some]).astype(np.uint16))
        sizes[t] = len(which[-1])
    of_spike = np.concatenate(which)
    in_order = np.argsort(of_spike, kind="stable")  # NumPy uses a radix sort for 16 bits
    samples = np.repeat(np.arange(n, dtype=np.int32), sizes)[in_order]
    starts = np.concatenate([[0], np.cumsum(np.bincount(of_spike, minlength=2 * m))])
    return starts, samples


class _Drives:
    """Input currents of both channels, sample by sample."""

    def __init__(self, first: NDArray[np.uint16]) -> None:
        self._b, self._a = butterworth(DEFAULT.ra_lowpass_hz, DEFAULT.sample_rate_hz)
        level = first / HIGHEST
        steady: Any = signal.lfilter_zi(self._b, self._a)
        self._z1, self._z2, self._last = steady[0] * level, steady[1] * level, level.copy()
        self._x, self._y, self._part = np.empty((3, len(first)))
        self._drive = np.empty(2 * len(first))
        self._sa, self._ra = np.split(self._drive, 2)

    def advance(self, readings: NDArray[np.uint16]) -> Reals:
        """Return the currents of the next sample, float64 (2·m,); the next call overwrites them."""
        x, y, part, (b0, b1, b2), (_, a1, a2) = self._x, self._y, self._part, self._b, self._a
        sa, ra = self._sa, self._ra
        np.divide(readings, HIGHEST, out=x)
        np.multiply(x, DEFAULT.sa_gain, out=sa)
        np.multiply(x, b0, out=y)
        y += self._z1
        np.multiply(x, b1, out=self._z1)
        self._z1 += self._z2
        np.multiply(y, a1, out=part)
        self._z1 -= part
        np.multiply(x, b2, out=self._z2)
        np.multiply(y, a2, out=part)
        self._z2 -= part
        np.subtract(y, self._last, out=ra)
        ra *= DEFAULT.ra_gain * DEFAULT.sample_rate_hz
        self._last, self._y = y, self._last
        return self._drive


class _Neurons:
    """Izhikevich neurons, at rest at first."""

    def __init__(self, m: int) -> None:
        self._v, self._u = np.full(m, -70.0), np.full(m, -14.0)
        self._rise, self._fired = np.empty(m), np.empty(m, bool)

    def advance(self, drive: Reals, spikes: NDArray[np.uint8]) -> None:
        """Advance by one sample of four substeps; add the spikes to ``spikes``, uint8 (m,)."""
        v, u, rise, fired = self._v, self._u, self._rise, self._fired
        for _ in range(4):
            np.multiply(v, 0.04, out=rise)
            rise += 5.0
            rise *= v
            rise += 140.0
            rise -= u
            rise += drive
            rise *= 0.25
            v += rise
            np.multiply(v, 0.2, out=rise)
            rise -= u
            rise *= 0.005
            u += rise
            np.greater_equal(v, 30.0, out=fired)
            (where,) = fired.nonzero()
            if len(where):  # an index is faster than a mask, which visits all neurons each time
                v[where] = -65.0
                u[where] += 6.0
                spikes[where] += 1
