"""Speed scaling: time runs in units of texture travelled, so that a spike's window is a place."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rigctl.errors import WrongUse
from rigctl.values import SAMPLE_RATE_HZ

REFERENCE_SPEED_MM_S = 120.0
WINDOW_MS = 100
UM = 1000


def windows_of_samples(
    n_samples: int,
    speed_mm_s: float,
    *,
    window_ms: int = WINDOW_MS,
    reference_mm_s: float = REFERENCE_SPEED_MM_S,
) -> NDArray[np.int64]:
    """Window of each sample of a trial, int64 (n_samples,), ascending from 0.

    A window is the texture that passes in ``window_ms`` at the reference speed: in integers
    (t·v) // (window · reference), which is (t·v) // 12000 for the paper's numbers. Floating-point
    bins would put some samples on the wrong side. Speeds count to the µm/s. With the speed equal
    to the reference the windows are plain time. Raises :class:`WrongUse` for a speed not above 0.
    """
    speed, window = _whole(speed_mm_s, window_ms, reference_mm_s)
    travelled = np.arange(n_samples, dtype=np.int64) * speed
    return travelled // window


def window_begins(
    n_windows: int,
    speed_mm_s: float,
    *,
    window_ms: int = WINDOW_MS,
    reference_mm_s: float = REFERENCE_SPEED_MM_S,
) -> NDArray[np.int64]:
    """First sample of each window that :func:`windows_of_samples` tells, int64 (n_windows + 1,).

    The last is the first behind them all. A window that is too short for a sample begins where the
    next one does. Raises as the other.
    """
    speed, window = _whole(speed_mm_s, window_ms, reference_mm_s)
    return -(-np.arange(n_windows + 1, dtype=np.int64) * window // speed)


def _whole(speed_mm_s: float, window_ms: int, reference_mm_s: float) -> tuple[int, int]:
    """What one sample travels, and a window's length, in the same whole numbers."""
    speed, reference = round(speed_mm_s * UM), round(reference_mm_s * UM)
    if speed <= 0 or reference <= 0:
        raise WrongUse(f"speed scaling needs speeds above 0, not {speed_mm_s:g} mm/s")
    window_samples = window_ms * SAMPLE_RATE_HZ // 1000
    if window_samples <= 0:
        raise WrongUse(f"a feature window of {window_ms} ms holds no sample")
    return speed, window_samples * reference


def scaled_time_s(
    sample_index: NDArray[np.int32],
    speed_mm_s: float,
    reference_mm_s: float = REFERENCE_SPEED_MM_S,
) -> NDArray[np.float64]:
    """Spike times in speed-scaled seconds, float64: t·v / reference (the paper's eq. 2)."""
    return sample_index.astype(np.float64) * (speed_mm_s / (reference_mm_s * SAMPLE_RATE_HZ))
