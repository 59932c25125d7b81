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

from rigctl.encoding.root_bracket import SearchStatus
from rigctl.errors import WrongUse

Floats = NDArray[np.float64]

REFERENCE_FORCE_G = 500.0


@dataclass(frozen=True, slots=True)
class ForceMatrix:
    """C and how its search ended, arrays of shape (textures, n_taxels, speeds, forces).

    ``residual_hz``: the rate reached minus the target. ``rate_hz``: the rate reached, or None where
    it was not kept (files of older versions).
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
        return self.c[t, :, v, f]

    def texture_blind(self, speed_mm_s: float, force_g: float) -> Floats:
        """Return the mean of C over the textures, float64 (n_taxels,): it uses no label."""
        v, f = self._indices(speed_mm_s, force_g)
        mean: Floats = self.c[:, :, v, f].mean(axis=0)
        return mean

    @property
    def unconverged(self) -> int:
        """Number of entries that are limited to 5 or at a jump (the paper: 62 of 4,320)."""
        failed = (SearchStatus.CAPPED, SearchStatus.DISCONTINUITY)
        return int(np.isin(self.status, failed).sum())

    def _indices(self, speed_mm_s: float, force_g: float) -> tuple[int, int]:
        try:
            return self.speeds_mm_s.index(speed_mm_s), self.forces_g.index(force_g)
        except ValueError:
            raise WrongUse(
                f"the force matrix has no entry for {speed_mm_s:g} mm/s and {force_g:g} g"
            ) from None
