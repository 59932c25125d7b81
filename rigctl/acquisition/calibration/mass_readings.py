"""The readings with known masses, and the scale that fits them."""

from __future__ import annotations

from collections.abc import Callable

from rigctl.acquisition.calibration.calibration_values import LoadCellScale, MassReading
from rigctl.acquisition.calibration.load_cell_scale import fit_scale, validate_masses
from rigctl.errors import WrongUse

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
