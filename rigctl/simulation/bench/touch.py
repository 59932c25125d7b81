"""A person's fingers at the simulated sensor: places that are pressed, lines that are unplugged.

Levels are shares of the supply, in the order of the readings (:mod:`rigctl.simulation.bench.skin`).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.values import DRAWN_WIRING, N_TAXELS

SIDE = 3
N_PLACES = SIDE * SIDE
PRESSED_LEVEL = 0.45
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

    def apply(self, levels: NDArray[np.float64]) -> None:
        """Change levels, (n, 18), as the touch does."""
        if self.places:
            np.maximum(levels, _pressed_levels(self.places), out=levels)
        if self.is_unplugged:
            levels[:, np.isin(np.arange(N_TAXELS) % _N_INPUTS, _BOTTOM_INPUTS)] = 0.0


NO_TOUCH = Touch()


def _pressed_levels(places: Iterable[int]) -> NDArray[np.float64]:
    """Return the least level of each reading, (18,)."""
    rows, columns = np.divmod(np.arange(N_PLACES), SIDE)
    felt = np.zeros(N_PLACES)
    for place in places:
        away = abs(rows - place // SIDE) + abs(columns - place % SIDE)
        share = np.where(away == 0, 1.0, np.where(away == 1, NEIGHBOUR_SHARE, 0.0))
        felt = np.maximum(felt, share)
    levels = np.empty(N_TAXELS)
    levels[_READING] = PRESSED_LEVEL * np.concatenate([felt, BOTTOM_SHARE * felt])
    return levels
