"""Calls a virtual board from inside compiled code, by the address of its C function."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic


def _call(context: Any, address: Any, handle: Any, argument: Any) -> Any:
    del context, address, handle, argument
    signature = types.void(types.int64, types.int64, types.int64)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        del signature
        word, byte = ir.IntType(64), ir.IntType(8)
        kind = ir.FunctionType(ir.VoidType(), [byte.as_pointer(), word])
        function = builder.inttoptr(arguments[0], kind.as_pointer())
        board = builder.inttoptr(arguments[1], byte.as_pointer())
        builder.call(function, [board, arguments[2]])
        return context.get_dummy_value()

    return signature, generate


call_board: Any = intrinsic(_call)
"""``call_board(address, handle, argument)`` calls ``void function(void *board, int64_t argument)``.

The address is an argument, not a constant, so that the compiled caller can be kept on disk.
"""
