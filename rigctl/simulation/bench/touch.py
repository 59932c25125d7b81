"""A person's fingers at the simulated sensor: places that are pressed, lines that are unplugged.

Conductances are in units of the divider's, in the order of the readings
(:mod:`rigctl.simulation.bench.skin`).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.values import DRAWN_WIRING, N_TAXELS

SIDE = 3
N_PLACES = SIDE * SIDE
PRESSED = 0.8
BOTTOM_SHARE, NEIGHBOUR_SHARE = 0.6, 0.3
"""What the bottom layer and a neighbouring place feel of a press."""
_N_INPUTS = 6
_READING = np.array(DRAWN_WIRING)
_BOTTOM_INPUTS = np.unique(_READING[N_PLACES:] % _N_INPUTS)


@dataclass(frozen=True, slots=True)
class Touch:
    """What a person does: ``places``, row by row from 0, are pressed with a blunt tip.

    ``is_unplugged``: the bottom layer's read lines are unplugged.
    """

    places: frozenset[int] = frozenset()
    is_unplugged: bool = False

    def apply(self, conductances: NDArray[np.float64]) -> None:
        """Change conductances, (n, 18), as the touch does."""
        if self.places:
            np.maximum(conductances, _pressed(self.places), out=conductances)
        if self.is_unplugged:
            conductances[:, np.isin(np.arange(N_TAXELS) % _N_INPUTS, _BOTTOM_INPUTS)] = 0.0


NO_TOUCH = Touch()


def _pressed(places: Iterable[int]) -> NDArray[np.float64]:
    """Return the least conductance of each reading, (18,)."""
    rows, columns = np.divmod(np.arange(N_PLACES), SIDE)
    felt = np.zeros(N_PLACES)
    for place in places:
        away = abs(rows - place // SIDE) + abs(columns - place % SIDE)
        share = np.where(away == 0, 1.0, np.where(away == 1, NEIGHBOUR_SHARE, 0.0))
        felt = np.maximum(felt, share)
    conductances = np.empty(N_TAXELS)
    conductances[_READING] = PRESSED * np.concatenate([felt, BOTTOM_SHARE * felt])
    return conductances
