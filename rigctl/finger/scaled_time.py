"""Speed invariance of the moving finger: scaled time in batches of changing velocity, in integers.

Scaled time is ∫ v dt / v_ref (Iskarous et al., equation 2, applied to each 100 ms). 1 µm/s for 1 ms
is 1 nm, and a window of 100 ms of scaled time is 100 · v_ref nanometres (10 mm at 100 mm/s), so
nothing is rounded. The finger's board computes the same windows. :class:`Gaps` names the other
reading of the paper's words.
"""

from __future__ import annotations

from enum import StrEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.encoder.features import WINDOW_MS
from rigctl.errors import WrongUse

REFERENCE_UM_PER_S = 100_000
"""Reference speed of the real-time experiment; the drum's is another."""
BATCH_SAMPLES = 100
N_WINDOWS = 20
MS_PER_S = 1000.0

Spikes1Khz = NDArray[np.uint8]
Counts = NDArray[np.int64]
Floats = NDArray[np.float64]


class Gaps(StrEnum):
    """What happens to a gap between two spikes of a train that lie in different batches.

    The paper scales "the time gaps between spikes" by "the computed velocity of that window".
    """

    SPLIT = "split"  # at the border, each piece by its own velocity: ∫ v dt, as the board has it
    WHOLE = "whole"  # by the velocity of the batch in which the gap ends: the words taken literally


class ScaledWindows(NamedTuple):
    """Windows of a scan: ``counts`` of spikes, int64 (w, n_taxels); ``real_ms``, int64 (w,).

    ``real_ms`` is the real time that the finger spent in the window.
    """

    counts: Counts
    real_ms: Counts

    @property
    def rates_hz(self) -> Floats:
        """Spike rates, float64 (w, n_taxels): counts over real time, as the board has them."""
        rates: Floats = self.counts * MS_PER_S / np.maximum(self.real_ms, 1)[:, None]
        return rates


def scale_windows(
    spikes: Spikes1Khz,
    velocities_um_per_s: Counts,
    reference_um_per_s: int = REFERENCE_UM_PER_S,
    batch_samples: int = BATCH_SAMPLES,
    gaps: Gaps = Gaps.SPLIT,
    window_ms: int = WINDOW_MS,
) -> ScaledWindows:
    """Return the windows of scaled time of one scan: spikes uint8 (n, n_taxels) at 1 kHz.

    ``velocities_um_per_s``: int64, one for each batch; the last batch may be short, and so may the
    last window of ``window_ms``. Windows and their real time are those of the finger's way; spikes
    whose whole gaps lead beyond it are dropped. Raises :class:`WrongUse` for another number of
    velocities, a negative one, or one so high that a window would be shorter than a sample.
    """
    window_nm = window_ms * reference_um_per_s
    velocities = np.asarray(velocities_um_per_s, np.int64)
    _check_velocities(velocities, -(-len(spikes) // batch_samples), window_nm)
    per_sample = np.repeat(velocities, batch_samples)[: len(spikes)]
    window = (np.cumsum(per_sample) - per_sample) // window_nm
    n_windows = int(window[-1]) + 1 if len(window) else 0
    counts = np.zeros((n_windows, spikes.shape[1]), np.int64)
    if gaps is Gaps.SPLIT:
        np.add.at(counts, window, spikes)
    else:
        for taxel, train in enumerate(spikes.T):
            at = np.flatnonzero(train)
            place = np.cumsum(np.diff(at, prepend=0) * per_sample[at]) // window_nm
            inside = place < n_windows
            np.add.at(counts[:, taxel], place[inside], train[at[inside]])
    return ScaledWindows(counts, np.bincount(window, minlength=n_windows))


def time_windows(spikes: Spikes1Khz, window_ms: int = WINDOW_MS) -> ScaledWindows:
    """Return the windows of a scan without speed scaling: whole ones; a remainder is dropped."""
    whole = len(spikes) // window_ms
    blocks = spikes[: whole * window_ms].reshape(whole, window_ms, spikes.shape[1])
    counts: Counts = blocks.sum(axis=1, dtype=np.int64)
    return ScaledWindows(counts, np.full(whole, window_ms, np.int64))


def first_windows(windows: ScaledWindows, n_windows: int = N_WINDOWS) -> Floats:
    """Return the rates of the first windows in Hz, float64 (n_windows, n_taxels), 0 where absent.

    Windows beyond the last one come from errors of the velocity and are dropped.
    """
    return _padded(windows.rates_hz[:n_windows], n_windows)


def last_windows(windows: ScaledWindows, n_windows: int = N_WINDOWS) -> Floats:
    """Return the rates of the last windows in Hz, float64 (n_windows, n_taxels), 0 where absent."""
    return _padded(windows.rates_hz[-n_windows:], n_windows)


def speed_scaled_features(windows: ScaledWindows, n_windows: int = N_WINDOWS) -> Floats:
    """Return the Speed Scaled feature vector, float64 (n_taxels · n_windows,), taxel after taxel.

    Materials and Methods, Real-time Texture Classification – Feature Extraction.
    """
    return feature_vector(first_windows(windows, n_windows))


def original_features(spikes: Spikes1Khz, n_windows: int = N_WINDOWS) -> Floats:
    """Return the Original feature vector, float64 (n_taxels · n_windows,), taxel after taxel.

    It holds the last ``n_windows`` whole windows of 100 ms, or all of them and zeros behind.
    """
    return feature_vector(last_windows(time_windows(spikes), n_windows))


def feature_vector(rates_hz: Floats) -> Floats:
    """Return rates float64 (…, windows, taxels) as vectors (…, taxels · windows)."""
    swapped = np.swapaxes(rates_hz, -1, -2)
    return swapped.reshape(*swapped.shape[:-2], -1)


def _padded(rates_hz: Floats, n_windows: int) -> Floats:
    return np.pad(rates_hz, ((0, n_windows - len(rates_hz)), (0, 0)))


def _check_velocities(velocities: Counts, batches: int, window_nm: int) -> None:
    if velocities.shape != (batches,):
        raise WrongUse(
            f"a scan of {batches} batches needs as many velocities, not {velocities.size}"
        )
    if batches and not 0 <= velocities.min() <= velocities.max() <= window_nm:
        raise WrongUse(
            f"velocities must lie between 0 and {window_nm} µm/s: a window holds a sample or more"
        )
