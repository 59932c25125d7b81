"""Force scaling: the factor C on the SA current that brings a taxel's rate to its rate at 500 g.

One C for each texture, taxel, speed and force (the paper's eq. 1). C is indexed by the true
texture, so whatever is classified with it has seen the label, and it has seen every force it was
made for; :meth:`ForceMatrix.texture_blind` averages over the textures. A change of the sensor voids
it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.encoding.batch import mean_level
from rigctl.encoding.force_search import TOLERANCE_HZ, mean_sa_rates_hz, search_to
from rigctl.encoding.kernel.prefetch import Trials
from rigctl.encoding.normalisation import Normalisation
from rigctl.encoding.parameters import DEFAULT, EncoderParameters
from rigctl.encoding.root_bracket import Method, SearchStatus
from rigctl.errors import WrongUse

Floats = NDArray[np.float64]

REFERENCE_FORCE_G = 500.0


@dataclass(frozen=True, slots=True)
class ForceMatrix:
    """C with how it was found, arrays of shape (textures, n_taxels, speeds, forces).

    ``residual_hz``: the rate reached less the target.
    """

    textures: tuple[str, ...]
    speeds_mm_s: tuple[float, ...]
    forces_g: tuple[float, ...]
    reference_g: float
    c: Floats
    status: NDArray[np.int8]
    residual_hz: Floats
    evaluations: Floats

    def of(self, texture: str, speed_mm_s: float, force_g: float) -> Floats:
        """C of each taxel, float64 (n_taxels,). Raises WrongUse for a condition it lacks."""
        try:
            t = self.textures.index(texture)
        except ValueError:
            raise WrongUse(f"the force matrix has no texture {texture}") from None
        v, f = self._place(speed_mm_s, force_g)
        return self.c[t, :, v, f]

    def texture_blind(self, speed_mm_s: float, force_g: float) -> Floats:
        """Mean of C over the textures, float64 (n_taxels,): knows no label."""
        v, f = self._place(speed_mm_s, force_g)
        mean: Floats = self.c[:, :, v, f].mean(axis=0)
        return mean

    @property
    def unconverged(self) -> int:
        """Entries that were capped or lie at a jump (the paper: 62 of 4,320)."""
        return int(np.sum(self.status > SearchStatus.CONVERGED))

    def _place(self, speed_mm_s: float, force_g: float) -> tuple[int, int]:
        try:
            return self.speeds_mm_s.index(speed_mm_s), self.forces_g.index(force_g)
        except ValueError:
            raise WrongUse(
                f"the force matrix was not made for {speed_mm_s:g} mm/s and {force_g:g} g"
            ) from None


def force_matrix(
    trials_of: Callable[[str, float, float], Trials],
    textures: Sequence[str],
    speeds_mm_s: Sequence[float],
    forces_g: Sequence[float],
    normalisation: Normalisation,
    parameters: EncoderParameters = DEFAULT,
    *,
    reference_g: float = REFERENCE_FORCE_G,
    tolerance_hz: float = TOLERANCE_HZ,
    method: Method = Method.REGULA_FALSI,
) -> ForceMatrix:
    """Search every C. ``trials_of(texture, speed, force)`` gives the trials of a condition.

    Raises :class:`WrongUse` where the reference force is none of the forces, or a condition has no
    trials.
    """
    if reference_g not in forces_g:
        raise WrongUse(f"force scaling needs trials at the reference force of {reference_g:g} g")
    shape = (len(textures), normalisation.n_taxels, len(speeds_mm_s), len(forces_g))
    c, residual = np.ones(shape), np.zeros(shape)
    status, evaluations = np.zeros(shape, np.int8), np.zeros(shape)
    for t, texture in enumerate(textures):
        for v, speed in enumerate(speeds_mm_s):
            reference = _trials(trials_of, texture, speed, reference_g)
            target = mean_sa_rates_hz(reference, normalisation, parameters)
            goal = mean_level(reference, normalisation)
            for f, force in enumerate(forces_g):
                if force == reference_g:
                    continue
                trials = _trials(trials_of, texture, speed, force)
                found = search_to(
                    trials,
                    goal,
                    target,
                    normalisation,
                    parameters,
                    tolerance_hz=tolerance_hz,
                    method=method,
                )
                c[t, :, v, f], status[t, :, v, f] = found.c, found.status
                residual[t, :, v, f] = found.rate_hz - target
                evaluations[t, :, v, f] = found.evaluations
    names = (tuple(textures), tuple(speeds_mm_s), tuple(forces_g))
    return ForceMatrix(*names, reference_g, c, status, residual, evaluations)


def _trials(
    trials_of: Callable[[str, float, float], Trials], texture: str, speed: float, force: float
) -> Trials:
    trials = trials_of(texture, speed, force)
    if not trials:
        raise WrongUse(
            f"force scaling has no trial of texture {texture} at {speed:g} mm/s and {force:g} g"
        )
    return trials
