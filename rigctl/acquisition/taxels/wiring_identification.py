"""Which reading is which taxel, found by unplugging a layer and pressing one place after another.

Two layers lie over each other, so a press moves a taxel of both; which of the two is the upper one
only an unplugged read line tells. All readings here are in the order of the wire, reading
6 · line + input, and a step is the mean of some hundred samples, float64 (18,).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rigctl.errors import WrongUse
from rigctl.values import N_TAXELS
from rigctl.wire.taxels.self_test import INPUT_PINS, LINE_PINS, N_INPUTS

Means = NDArray[np.float64]

LEAST_COUNTS = 16.0
"""A taxel that changes by less was not pressed; the mean of a second scatters by a tenth."""
LEAST_RATIO = 1.3
"""So much stronger than any other of its layer is the taxel that was pressed."""
SIDE = 3
PER_LAYER = SIDE * SIDE


class WiringIdentification:
    """What was seen so far. ``upper``, ``lower``: inputs of each layer; the readings by place."""

    def __init__(self) -> None:
        self.upper: tuple[int, ...] = ()
        self.lower: tuple[int, ...] = ()
        self._pairs: list[tuple[int, int]] = []

    @property
    def place(self) -> int:
        """The place to be pressed next, row by row from 0; 9 where all are known."""
        return len(self._pairs)

    def unplugged(self, rest: Means, pressed: Means) -> str:
        """Take a press on the whole sensor while the bottom layer's read lines are unplugged.

        The answer says what was seen. Raises WrongUse where other than three inputs are silent.
        """
        answers = np.abs(pressed - rest).reshape(-1, N_INPUTS).max(axis=0)
        silent = tuple(np.flatnonzero(answers < LEAST_COUNTS).tolist())
        if len(silent) != SIDE:
            raise WrongUse(
                f"{_inputs(silent)} did not answer, and of a layer it must be three: unplug the "
                "three read lines of the bottom layer and nothing else, and press the whole sensor"
            )
        self.lower = silent
        self.upper = tuple(i for i in range(N_INPUTS) if i not in silent)
        return f"top layer: {_inputs(self.upper)}; bottom layer: {_inputs(self.lower)}"

    def pressed(self, rest: Means, pressed: Means) -> str:
        """Take a press on :attr:`place`; the answer says what was seen.

        Raises WrongUse, and remembers nothing of it, where it is not clear or contradicts
        another press.
        """
        change = np.abs(pressed - rest)
        pair = (
            _strongest(change, self.upper, "top"),
            _strongest(change, self.lower, "bottom"),
        )
        for reading in pair:
            for place, before in enumerate(self._pairs):
                if reading in before:
                    raise WrongUse(
                        f"{_wires(reading)} answered, as it did at {place_words(place)}: press "
                        f"{place_words(self.place)}"
                    )
        self._pairs.append(pair)
        upper, lower = (f"{_wires(r)} by {change[r]:.0f} counts" for r in pair)
        return f"{place_words(self.place - 1)}: {upper}, below it {lower}"

    def wiring(self) -> tuple[int, ...]:
        """The reading at each place, the top layer first.

        Raises WrongUse where the readings of a layer are not those of lines that cross inputs.
        """
        layers = list(zip(*self._pairs, strict=True))
        for readings, name in zip(layers, ("top", "bottom"), strict=True):
            _check_crossing(readings, name)
        return tuple(int(reading) for readings in layers for reading in readings)


def place_words(place: int) -> str:
    """A place for a person: row and column."""
    return f"row {place // SIDE + 1}, column {place % SIDE + 1}"


def _strongest(change: Means, inputs: Sequence[int], layer: str) -> int:
    """The reading of a layer that answered alone. Raises WrongUse where none or several did."""
    readings = [reading for reading in range(N_TAXELS) if reading % N_INPUTS in inputs]
    first, second = sorted(readings, key=lambda reading: -change[reading])[:2]
    if change[first] < LEAST_COUNTS:
        raise WrongUse(f"no taxel of the {layer} layer answered: press harder, with a blunt tip")
    if change[first] < LEAST_RATIO * change[second]:
        raise WrongUse(
            f"{_wires(first)} and {_wires(second)} of the {layer} layer answered alike: press one "
            "place only, with a tip of about 3 mm"
        )
    return first


def _check_crossing(readings: Sequence[int], layer: str) -> None:
    """Raise WrongUse unless the readings' lines are the rows and their inputs the columns.

    Or the other way round: a sensor may be looked at from another side.
    """
    square = np.array(readings).reshape(SIDE, SIDE)
    for grid in (square, square.T):
        lines, inputs = grid // N_INPUTS, grid % N_INPUTS
        if (lines == lines[:, :1]).all() and (inputs == inputs[:1]).all():
            return
    raise WrongUse(
        f"the rows and columns of the {layer} layer do not cross as lines and inputs do: a press "
        "was at another place than asked for, or a wire came loose; begin again"
    )


def _inputs(numbers: Sequence[int]) -> str:
    names = [INPUT_PINS[i] for i in numbers]
    return f"input{'s' * (len(names) != 1)} {', '.join(names)}" if names else "no input"


def _wires(reading: int) -> str:
    line, input_ = divmod(reading, N_INPUTS)
    return f"{LINE_PINS[line]}·{INPUT_PINS[input_]}"
