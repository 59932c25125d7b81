"""The scale of a load cell from known masses."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rigctl.acquisition.calibration.calibration_values import (
    LoadCellScale,
    MassReading,
    ScaleLine,
)
from rigctl.errors import WrongUse
from rigctl.values import SCALE_BAND_UG_PER_COUNT

MIN_SPAN_COUNTS = 500
MAX_SPREAD_SHARE = 0.01
MAX_NONLINEARITY_SHARE = 0.02
FULL_SCALE_COUNTS = 8_388_607


def fit_scale(readings: Sequence[MassReading]) -> LoadCellScale:
    """Return the scale that fits an empty reading and one of each mass.

    Raises WrongUse for implausible readings.
    """
    masses = np.array([reading.mass_g for reading in readings])
    counts = np.array([reading.mean_counts for reading in readings])
    _validate_readings(readings, abs(float(counts[masses.argmax()] - counts[masses.argmin()])))
    line = fit_line(readings)
    nonlinearity = max(map(abs, line.residuals_g)) / float(masses.max())
    if nonlinearity > MAX_NONLINEARITY_SHARE:
        raise WrongUse(
            f"the readings are not proportional to the masses ({100 * nonlinearity:.1f} % off): "
            "check the masses, and that nothing touches the drum"
        )
    ug_per_count = round(line.g_per_count * 1e6)
    low, high = SCALE_BAND_UG_PER_COUNT
    if not low <= abs(ug_per_count) <= high:
        raise WrongUse(
            f"a scale of {ug_per_count} µg per count is impossible ({low} to {high} are possible): "
            "check the masses and the wiring"
        )
    return LoadCellScale(ug_per_count, nonlinearity)


def fit_line(readings: Sequence[MassReading]) -> ScaleLine:
    """Return the straight line nearest to the readings, which differ, plausible or not."""
    masses = np.array([reading.mass_g for reading in readings])
    counts = np.array([reading.mean_counts for reading in readings])
    g_per_count, offset_g = np.polyfit(counts, masses, 1)
    residuals = masses - (g_per_count * counts + offset_g)
    return ScaleLine(float(g_per_count), float(offset_g), tuple(residuals.tolist()))


def _validate_readings(readings: Sequence[MassReading], span_counts: float) -> None:
    if max(abs(reading.mean_counts) for reading in readings) >= FULL_SCALE_COUNTS - 1:
        raise WrongUse("the load cell is at the end of its range: take a smaller mass")
    if span_counts < MIN_SPAN_COUNTS:
        raise WrongUse(
            f"the reading changed by only {span_counts:.0f} counts: check that the mass is on the "
            "drum and that the load cell is wired"
        )
    noisiest = max(readings, key=lambda reading: reading.sd_counts)
    if noisiest.sd_counts > MAX_SPREAD_SHARE * span_counts:
        raise WrongUse(
            f"the reading at {noisiest.mass_g:g} g is unstable (± {noisiest.sd_counts:.0f} of "
            f"{span_counts:.0f} counts): let the drum come to rest, then calibrate again"
        )


def validate_masses(masses_g: Sequence[float]) -> None:
    """Raise WrongUse for masses that cannot calibrate the load cell."""
    if not masses_g or min(masses_g) <= 0 or len(set(masses_g)) < len(masses_g):
        raise WrongUse("give each known mass once, in grams above 0, such as 500")
