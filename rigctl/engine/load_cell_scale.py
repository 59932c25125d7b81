"""The scale of a load cell from known masses."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from rigctl.engine.calibration_values import LoadCellScale, MassReading, ScaleLine
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


EMPTY_FIRST = "read the load cell without a mass first: take everything off the drum"


class MassReadings:
    """Readings in the order of their masses, one for each.

    ``scale``: None without a plausible one, and ``problem`` says why; empty before there are two.
    """

    def __init__(self) -> None:
        self.readings: tuple[MassReading, ...] = ()
        self.scale: LoadCellScale | None = None
        self.problem = ""

    @property
    def masses_g(self) -> list[float]:
        """The known masses, without the empty reading."""
        return [reading.mass_g for reading in self.readings if reading.mass_g]

    def validate_next(self, mass_g: float) -> None:
        """Raise WrongUse for a mass before the empty reading."""
        if mass_g and not self.readings:
            raise WrongUse(EMPTY_FIRST)

    def add(self, reading: MassReading) -> None:
        """Add a reading; it replaces one with the same mass."""
        self._take([*(r for r in self.readings if r.mass_g != reading.mass_g), reading])

    def remove(self, mass_g: float) -> None:
        """Remove the reading with a mass. Raises WrongUse where there is none."""
        kept = [reading for reading in self.readings if reading.mass_g != mass_g]
        if len(kept) == len(self.readings):
            raise WrongUse(f"there is no reading with {mass_g:g} g")
        if not mass_g and kept:
            raise WrongUse("the scale needs the reading without a mass: read it again instead")
        self._take(kept)

    def fitted_scale(self) -> LoadCellScale:
        """Return the scale. Raises WrongUse for too few or implausible readings."""
        validate_masses(self.masses_g)
        return fit_scale(self.readings)

    def _take(self, readings: list[MassReading]) -> None:
        self.readings = tuple(sorted(readings))
        self.scale, self.problem = None, ""
        if self.masses_g:
            self.scale, self.problem = _fit(self.fitted_scale)


def _fit(fit: Callable[[], LoadCellScale]) -> tuple[LoadCellScale | None, str]:
    """Return the scale, or None and why there is none."""
    try:
        return fit(), ""
    except WrongUse as implausible:
        return None, str(implausible)
