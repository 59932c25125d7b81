"""Compile loops over samples with Numba."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

from llvmlite import ir
from numba import njit
from numba.extending import intrinsic

F = TypeVar("F", bound=Callable[..., Any])


def compiled(function: F) -> F:
    """Compile a kernel at its first call; it releases the GIL while it runs."""
    return cast(F, njit(nogil=True, cache=True, error_model="numpy")(function))


def inlined(function: F) -> F:
    """Compile a small function into the kernels that call it."""
    return cast(F, njit(nogil=True, error_model="numpy", inline="always")(function))


def _emit_uncounted(_: object, array: Any) -> tuple[Any, Callable[..., Any]]:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        value = context.make_array(array)(context, builder, arguments[0])
        value.meminfo = ir.Constant(value.meminfo.type, None)
        return value._getvalue()

    return array(array), generate


uncounted: Any = intrinsic(_emit_uncounted)
"""``uncounted(array)``, in a kernel, returns an array that the caller holds, without its count.

Numba counts the users of an array by atomic operations, a dozen in each turn of a loop that calls
functions. An array that the kernel itself makes would be freed too early.
"""
