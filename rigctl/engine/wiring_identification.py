"""Identify each taxel's reading from one unplugged layer and a press at each place.

The sensor has two layers, so a press changes one taxel of each; only an unplugged read line shows
which of the two is the upper one. All readings here are in the order of the wire, reading
6 · line + input, and each step uses the mean of some hundred samples, float64 (18,).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rigctl.boards.taxel_frames import N_INPUTS, input_name, line_name
from rigctl.errors import WrongUse

MeanReadings = NDArray[np.float64]

MIN_CHANGE_COUNTS = 16.0
"""A taxel that changes by less was not pressed; the mean of a second scatters by a tenth."""
MIN_CHANGE_RATIO = 1.3
"""The pressed taxel changes by this factor more than any other of its layer."""
SIDE = 3
PER_LAYER = SIDE * SIDE
N_STEPS = 3 + PER_LAYER
"""Unplug, press flat, plug in, and a press of each place."""


class ContradictoryPresses(WrongUse):
    """The presses together are no sensor: the identification begins again."""


class WiringIdentification:
    """Identification from the presses so far; ``upper``, ``lower``: inputs of each layer."""

    def __init__(self) -> None:
        self.upper: tuple[int, ...] = ()
        self.lower: tuple[int, ...] = ()
        self._pairs: list[tuple[int, int]] = []

    @property
    def place(self) -> int:
        """The place to press next, row by row from 0; 9 where all are known."""
        return len(self._pairs)

    @property
    def pairs(self) -> tuple[tuple[int, int], ...]:
        """The readings at the places so far: of the top layer, and of the bottom layer."""
        return tuple(self._pairs)

    def add_unplugged_press(self, rest: MeanReadings, pressed: MeanReadings) -> str:
        """Add a press on the whole sensor with the bottom layer's read lines unplugged.

        Returns a sentence on the result. Raises WrongUse unless exactly three inputs are silent.
        """
        change = np.abs(pressed - rest).reshape(-1, N_INPUTS).max(axis=0)
        silent = tuple(np.flatnonzero(change < MIN_CHANGE_COUNTS).tolist())
        if len(silent) != SIDE:
            raise WrongUse(
                f"{_input_names(silent)} did not respond, but a layer has three inputs: unplug "
                "only the three read lines of the bottom layer, and press the whole sensor"
            )
        self.lower = silent
        self.upper = tuple(i for i in range(N_INPUTS) if i not in silent)
        return f"top layer: {_input_names(self.upper)}; bottom layer: {_input_names(self.lower)}"

    def add_press(self, rest: MeanReadings, pressed: MeanReadings) -> str:
        """Add a press on :attr:`place` and return a sentence on the result.

        Raises WrongUse, and adds nothing, where it is not clear or contradicts another press.
        """
        change = np.abs(pressed - rest)
        pair = (_strongest(change, self.upper, "top"), _strongest(change, self.lower, "bottom"))
        for reading in pair:
            for place, other in enumerate(self._pairs):
                if reading in other:
                    raise WrongUse(
                        f"{reading_name(reading)} responded, as it did at {place_name(place)}: "
                        f"press {place_name(self.place)}"
                    )
        self._pairs.append(pair)
        upper, lower = (f"{reading_name(r)} by {change[r]:.0f} counts" for r in pair)
        return f"{place_name(self.place - 1)}: {upper}, below it {lower}"

    def remove_press(self) -> None:
        """Forget the last press. Raises WrongUse where there is none."""
        if not self._pairs:
            raise WrongUse("no place has been pressed yet: press the one that is asked for")
        self._pairs.pop()

    def wiring(self) -> tuple[int, ...]:
        """Return the reading at each place, the top layer first.

        Raises ContradictoryPresses where a layer does not have one line per row and one input per
        column.
        """
        layers = list(zip(*self._pairs, strict=True))
        for readings, name in zip(layers, ("top", "bottom"), strict=True):
            _validate_crossing(readings, name)
        return tuple(int(reading) for readings in layers for reading in readings)


def place_name(place: int) -> str:
    """Return a place as row and column."""
    return f"row {place // SIDE + 1}, column {place % SIDE + 1}"


def _strongest(change: MeanReadings, inputs: Sequence[int], layer: str) -> int:
    """Return the one reading of a layer that changed. Raises WrongUse where none or several did."""
    readings = [reading for reading in range(change.size) if reading % N_INPUTS in inputs]
    first, second = sorted(readings, key=lambda reading: -change[reading])[:2]
    if change[first] < MIN_CHANGE_COUNTS:
        raise WrongUse(f"no taxel of the {layer} layer responded: press harder, with a blunt tip")
    if change[first] < MIN_CHANGE_RATIO * change[second]:
        raise WrongUse(
            f"{reading_name(first)} and {reading_name(second)} of the {layer} layer responded "
            "alike: press one place only, with a tip of about 3 mm"
        )
    return first


def _validate_crossing(readings: Sequence[int], layer: str) -> None:
    """Raise ContradictoryPresses unless the lines are the rows and the inputs the columns.

    The transpose is valid too: the sensor may be turned.
    """
    square = np.array(readings).reshape(SIDE, SIDE)
    for grid in (square, square.T):
        lines, inputs = grid // N_INPUTS, grid % N_INPUTS
        if (lines == lines[:, :1]).all() and (inputs == inputs[:1]).all():
            return
    raise ContradictoryPresses(
        f"the presses on the {layer} layer do not form rows of one line and columns of one input: "
        "a press was at a wrong place, or a wire came loose; begin again"
    )


def _input_names(numbers: Sequence[int]) -> str:
    names = [input_name(i) for i in numbers]
    return f"input{'s' * (len(names) != 1)} {', '.join(names)}" if names else "no input"


def reading_name(reading: int) -> str:
    """Return a reading as its line and its input."""
    line, input_ = divmod(reading, N_INPUTS)
    return f"{line_name(line)}·{input_name(input_)}"
