"""How the world's kernels are compiled: no Python objects, no lock, kept on disk.

A kernel calls no kernel of another file: the kept machine code is renewed when its own file
changes and would not notice the other.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, TypeVar, cast

from numba import njit

F = TypeVar("F", bound=Callable[..., Any])


def compiled(function: F) -> F:
    """Compile at first call; releases the interpreter's lock while it runs."""
    return cast(F, njit(nogil=True, cache=True, error_model="numpy")(function))


def inlined(function: F) -> F:
    """A small function for kernels of the same file."""
    return cast(F, njit(nogil=True, error_model="numpy")(function))


@inlined
def around(place_mm: float, turn_mm: float) -> float:
    """``place_mm % turn_mm`` to the bit; a turn of whole millimetres needs no long division."""
    if turn_mm != math.floor(turn_mm):
        return place_mm % turn_mm
    within = place_mm - math.floor(place_mm / turn_mm) * turn_mm
    return within + turn_mm if within < 0.0 else within
