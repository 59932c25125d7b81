"""Numba options of the simulation's kernels: no Python objects, no GIL, cached on disk.

A compiled kernel must not call a compiled kernel of another file: numba renews the cached machine
code when the kernel's own file changes, and would not notice a change of the other file.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, TypeVar, cast

from numba import njit

F = TypeVar("F", bound=Callable[..., Any])


def compiled(function: F) -> F:
    """Compile a kernel at its first call; it releases the GIL while it runs."""
    return cast(F, njit(nogil=True, cache=True, error_model="numpy")(function))


def inlined(function: F) -> F:
    """Compile a small function that kernels inline."""
    return cast(F, njit(nogil=True, error_model="numpy")(function))


@inlined
def modulo(position_mm: float, turn_mm: float) -> float:
    """Return ``position_mm % turn_mm`` to the bit; faster for a turn of whole millimetres."""
    if turn_mm != math.floor(turn_mm):
        return position_mm % turn_mm
    within = position_mm - math.floor(position_mm / turn_mm) * turn_mm
    return within + turn_mm if within < 0.0 else within
