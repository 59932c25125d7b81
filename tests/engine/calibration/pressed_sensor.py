"""A model of a pressed sensor: the board's readings for any wiring."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

PER_LAYER, SIDE, N_INPUTS = 9, 3, 6


def wiring_of(lines: Sequence[int], inputs: Sequence[int], turned: bool) -> tuple[int, ...]:
    """Return the reading at each place of a sensor whose row r is ``lines[r]``.

    The columns of the top layer are ``inputs[:3]``, those of the bottom one ``inputs[3:]``.
    ``turned``: the sensor is turned, so that lines are columns.
    """
    places = [(r, c) for r in range(SIDE) for c in range(SIDE)]
    crossed = [(c, r) if turned else (r, c) for r, c in places]
    return tuple(
        N_INPUTS * lines[r] + inputs[3 * layer + c] for layer in (0, 1) for r, c in crossed
    )


class PressedSensor:
    """A sensor that reads in the order of the wire, float64 (18,); a press spreads to neighbours.

    ``rest``: reading of every taxel; ``force``: change by a press on the upper layer.
    """

    def __init__(
        self, wiring: Sequence[int], *, rest: float = 60, force: float = 300, seed: int = 1
    ) -> None:
        self._wiring = np.array(wiring)
        self._rest = rest
        self._force = force
        self._random = np.random.default_rng(seed)

    @property
    def lower_inputs(self) -> NDArray[np.int64]:
        """Inputs of the bottom layer."""
        return np.unique(self._wiring[PER_LAYER:] % N_INPUTS)

    def rest(self, unplugged: bool = False) -> NDArray[np.float64]:
        """Return the readings without a touch."""
        return self.press([], unplugged)

    def press(self, places: Iterable[int], unplugged: bool = False) -> NDArray[np.float64]:
        """Press several places at once; the lower layer gets two thirds, a neighbour one third."""
        felt = np.zeros(PER_LAYER)
        for place in places:
            row, column = divmod(place, SIDE)
            rows, columns = np.divmod(np.arange(PER_LAYER), SIDE)
            away = np.abs(rows - row) + np.abs(columns - column)
            felt = np.maximum(felt, np.where(away == 0, 1.0, np.where(away == 1, 0.33, 0.0)))
        readings = np.empty(2 * PER_LAYER)
        readings[self._wiring] = self._rest + self._force * np.concatenate([felt, 0.66 * felt])
        if unplugged:
            readings[np.isin(np.arange(18) % N_INPUTS, self.lower_inputs)] = 0.0
        return np.clip(readings + self._random.normal(0, 0.2, 18), 0, 1023)
