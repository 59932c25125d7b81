"""A person's fingers at the simulated sensor: places that are pressed, lines that are unplugged.

Conductances are in units of the divider's, in the order of the readings
(:mod:`rigctl.bench.skin`).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.config.rig_config import PAPER_ARRAY, TaxelArray

N_PLACES = PAPER_ARRAY.shape[0] * PAPER_ARRAY.shape[1]
PRESSED = 0.8
BOTTOM_SHARE, NEIGHBOUR_SHARE = 0.6, 0.3
"""What the next layer below and a neighbouring place feel of a press."""


@dataclass(frozen=True, slots=True)
class Touch:
    """What a person does: ``places``, row by row from 0, are pressed with a blunt tip.

    ``is_unplugged``: the bottom layer's read lines are unplugged.
    """

    places: frozenset[int] = frozenset()
    is_unplugged: bool = False

    def apply(self, conductances: NDArray[np.float64], sensor: TaxelArray) -> None:
        """Change the conductances of a sensor, (n, n_taxels), as the touch does."""
        if self.places:
            np.maximum(conductances, _pressed(self.places, sensor), out=conductances)
        if self.is_unplugged:
            per_layer = sensor.shape[0] * sensor.shape[1]
            bottom = np.array(sensor.drawn_order[-per_layer:]) % sensor.inputs
            inputs = np.arange(sensor.count) % sensor.inputs
            conductances[:, np.isin(inputs, bottom)] = 0.0


NO_TOUCH = Touch()


def _pressed(places: Iterable[int], sensor: TaxelArray) -> NDArray[np.float64]:
    """Return the least conductance of each reading, (n_taxels,)."""
    n_rows, n_columns, n_layers = sensor.shape
    rows, columns = np.divmod(np.arange(n_rows * n_columns), n_columns)
    felt = np.zeros(rows.size)
    for place in places:
        away = abs(rows - place // n_columns) + abs(columns - place % n_columns)
        share = np.where(away == 0, 1.0, np.where(away == 1, NEIGHBOUR_SHARE, 0.0))
        felt = np.maximum(felt, share)
    conductances = np.empty(sensor.count)
    layers = [BOTTOM_SHARE**layer * felt for layer in range(n_layers)]
    conductances[list(sensor.drawn_order)] = PRESSED * np.concatenate(layers)
    return conductances
