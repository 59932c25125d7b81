"""``python -m rigctl.encoding.divider_table``: what a divider gives and what it costs.

For a taxel of 200 kΩ at rest and 5 kΩ pressed, or those given in kΩ.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

from rigctl.encoding.reading import FULL_SCALE, N_LINES

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
