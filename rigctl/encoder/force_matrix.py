"""Force scaling: the factor C on the SA current that brings a taxel's rate to its rate at 500 g.

One C for each texture, taxel, speed and force (the paper's eq. 1). C is indexed by the true
texture, so any classification with it uses the label, and C has used every force that it was
computed for; :meth:`ForceMatrix.texture_blind` averages over the textures. A change of the sensor
invalidates C.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.encoder.root_bracket import SearchStatus
from rigctl.errors import WrongUse

Floats = NDArray[np.float64]

REFERENCE_FORCE_G = 500.0


@dataclass(frozen=True, slots=True)
class ForceMatrix:
    """C and how its search ended, arrays of shape (textures, n_taxels, speeds, forces).

    An entry without trials has the status ABSENT and no meaning. ``residual_hz``: the rate reached
    minus the target. ``rate_hz``: the rate reached, or None where it was not kept (files of older
    versions).
    """

    textures: tuple[str, ...]
    speeds_mm_s: tuple[float, ...]
    forces_g: tuple[float, ...]
    reference_g: float
    c: Floats
    status: NDArray[np.int8]
    residual_hz: Floats
    evaluations: Floats
    rate_hz: Floats | None = None

    def c_at(self, texture: str, speed_mm_s: float, force_g: float) -> Floats:
        """Return C of each taxel, float64 (n_taxels,). Raises WrongUse for a missing condition."""
        try:
            t = self.textures.index(texture)
        except ValueError:
            raise WrongUse(f"the force matrix has no texture {texture}") from None
        v, f = self._indices(speed_mm_s, force_g)
        if not self._present[t, v, f]:
            raise WrongUse(
                f"the force matrix has no entry for texture {texture}, {speed_mm_s:g} mm/s and "
                f"{force_g:g} g"
            )
        return self.c[t, :, v, f]

    def texture_blind(self, speed_mm_s: float, force_g: float) -> Floats:
        """Return the mean of C over the textures that have one, float64 (n_taxels,): no label.

        Raises WrongUse where none has.
        """
        v, f = self._indices(speed_mm_s, force_g)
        present = self._present[:, v, f]
        if not present.any():
            raise WrongUse(_no_entry(speed_mm_s, force_g))
        c = self.c[:, :, v, f]
        mean: Floats = (c if present.all() else c[present]).mean(axis=0)
        return mean

    def covers(self, texture: str, speed_mm_s: float, force_g: float) -> bool:
        """Return whether there is a C for a condition whose levels are in the matrix."""
        v, f = self._indices(speed_mm_s, force_g)
        return bool(self._present[self.textures.index(texture), v, f])

    @property
    def absent_conditions(self) -> list[tuple[str, float, float]]:
        """Texture, speed and force of each condition without a C."""
        return [
            (self.textures[t], self.speeds_mm_s[v], self.forces_g[f])
            for t, v, f in np.argwhere(~self._present).tolist()
        ]

    @property
    def _present(self) -> NDArray[np.bool_]:
        """Which conditions have a C, bool (textures, speeds, forces)."""
        return np.asarray((self.status != SearchStatus.ABSENT).all(axis=1))

    @property
    def unconverged(self) -> int:
        """Number of entries that are limited to 5 or at a jump (the paper: 62 of 4,320)."""
        failed = (SearchStatus.CAPPED, SearchStatus.DISCONTINUITY)
        return int(np.isin(self.status, failed).sum())

    def _indices(self, speed_mm_s: float, force_g: float) -> tuple[int, int]:
        try:
            return self.speeds_mm_s.index(speed_mm_s), self.forces_g.index(force_g)
        except ValueError:
            raise WrongUse(_no_entry(speed_mm_s, force_g)) from None


def _no_entry(speed_mm_s: float, force_g: float) -> str:
    return f"the force matrix has no entry for {speed_mm_s:g} mm/s and {force_g:g} g"
