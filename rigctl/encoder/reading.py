"""What the encoder takes as a taxel's reading: counts, or the conductance behind them.

The taxels of an input, one a line, share its divider, and the lines that are not driven are held
low, so each loads the others; with three lines r_i = G_i / (G_1 + G_2 + G_3 + G_divider). With S =
r_1 + r_2 + r_3 this gives G_i = G_divider · r_i / (1 − S). Files hold counts; the conductance is
computed where samples are read, as a whole number of steps, so that live and offline encoders get
the same bits.
``docs/reference/encoding.md`` states the bound of its error.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from rigctl.errors import WrongUse

FULL_SCALE = 1023
STEPS = 4096
"""Steps of the divider's conductance: a quarter of the least change that a count can show."""
HIGHEST = 65_535
"""About 16 times the divider's conductance; more, as of a shorted taxel, reads the same."""
N_LINES = 3
"""Taxels of an input of the paper's board, which the printed table and bound are for."""
MIN_RANGE_COUNTS = 128


class Reading(StrEnum):
    """The quantity that taxel ranges and neurons work with."""

    COUNTS = "counts"
    CONDUCTANCE = "conductance"

    @property
    def unit(self) -> str:
        """The unit of a stored range."""
        return "stored counts" if self is Reading.COUNTS else f"divider's conductance / {STEPS}"

    @property
    def least_range(self) -> int:
        """Least width of a live range: well above the converter's noise, well below a touch."""
        return MIN_RANGE_COUNTS if self is Reading.COUNTS else MIN_RANGE_COUNTS * STEPS // 1024


def input_of_each(wiring: Sequence[int], n_inputs: int, where: str) -> tuple[int, ...]:
    """Return the analog input of each column of samples, from the reading at each place.

    ``n_inputs``: inputs of the board. Raises WrongUse, which begins with ``where``, for a wiring
    that is not one of lines that cross so many inputs.
    """
    whole = len(wiring) > 0 and len(wiring) % n_inputs == 0
    if not whole or sorted(wiring) != list(range(len(wiring))):
        raise WrongUse(
            f"{where} does not say which taxels share an input of the taxel board, so the "
            f"conductance is not known: use reading = {Reading.COUNTS}"
        )
    return tuple(reading % n_inputs for reading in wiring)


def conductance(samples: NDArray[np.uint16], inputs: Sequence[int]) -> NDArray[np.uint16]:
    """Return the conductance of each taxel in steps of the divider's / :data:`STEPS`.

    ``samples``: counts uint16 (n, n_taxels); ``inputs``: the input of each column, as
    :func:`input_of_each` returns it. Above :data:`HIGHEST` the steps saturate.
    """
    columns = np.array(inputs)
    # Sums of readings are exact in float32, whose matrix product is the fastest sum here.
    shared = (columns[:, None] == columns).astype(np.float32)
    rest = np.float32(FULL_SCALE) - samples.astype(np.float32) @ shared
    left = np.maximum(rest.astype(np.int32), 0)
    steps = samples.astype(np.int32) * STEPS + left // 2
    steps //= np.maximum(left, 1)
    found: NDArray[np.uint16] = np.minimum(steps, HIGHEST).astype(np.uint16)
    return found


DIVIDERS_KOHM = (0.1, 0.47, 1.0, 2.2, 4.7, 10.0, 22.0, 47.0)
REST_KOHM, PRESSED_KOHM = 200.0, 5.0
HEAD = (
    "| divider, kΩ | at rest, counts | one pressed | three pressed | lost by crosstalk "
    "| error of G, one pressed | three pressed |\n|---:|---:|---:|---:|---:|---:|---:|\n"
)


def quantisation_error(own: float, together: float) -> float:
    """Return the bound of a conductance's error by rounding to counts.

    ``own``: the conductance; ``together``: that of all taxels of its input; all in units of the
    divider's conductance.
    """
    half = 0.5 / FULL_SCALE
    return half * (1 + N_LINES * own) / (1 / (1 + together) - N_LINES * half)


def divider_table(rest_kohm: float = REST_KOHM, pressed_kohm: float = PRESSED_KOHM) -> str:
    """Return a line for each divider as Markdown; errors are relative to the conductance."""
    return HEAD + "".join(
        _line(kohm, kohm / rest_kohm, kohm / pressed_kohm) for kohm in DIVIDERS_KOHM
    )


def _line(divider_kohm: float, rest: float, pressed: float) -> str:
    one, three = pressed + (N_LINES - 1) * rest, N_LINES * pressed
    at_rest = FULL_SCALE * rest / (1 + N_LINES * rest)
    alone, among = (FULL_SCALE * pressed / (1 + together) for together in (one, three))
    errors = (quantisation_error(pressed, together) / pressed for together in (one, three))
    shown = " | ".join(f"{error:.1%}" for error in errors)
    counts = f"{at_rest:.0f} | {alone:.0f} | {among:.0f} | {1 - among / alone:.0%}"
    return f"| {divider_kohm:g} | {counts} | {shown} |\n"


def main(arguments: Sequence[str]) -> None:
    """Print the table for a taxel's resistance at rest and pressed."""
    print(divider_table(*map(float, arguments)), end="")


if __name__ == "__main__":
    main(sys.argv[1:])
