"""Load the boards' firmware that was compiled for this computer."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from rigctl.config.resources import checkout, installed_library
from rigctl.errors import RigFault
from rigctl.host_build import COMMAND, CURE, digest, dynamic_library_name, dynamic_library_path

Signatures = Mapping[str, tuple[Any, list[Any]]]
POINTER = ctypes.c_void_p
I32, I64, U64 = ctypes.c_int32, ctypes.c_int64, ctypes.c_uint64


_COMMON: Signatures = {
    "open": (POINTER, []),
    "close": (None, [POINTER]),
    "io": (POINTER, [POINTER]),
    "boot": (None, [POINTER, I32]),
}


class FirmwareLibrary:
    """One board in this process. Close it; nothing else frees its memory.

    ``name`` is ``drum`` or ``taxels``; ``io`` holds the board's inputs and outputs. Raises RigFault
    if the library, at ``path`` or at its build location, cannot be used.
    """

    def __init__(
        self,
        name: str,
        io_type: type[ctypes.Structure],
        signatures: Signatures,
        path: Path | None = None,
    ) -> None:
        self._name = name
        self._library = _load(name, io_type, {**_COMMON, **signatures}, path)
        self._functions = {key: self.function(key) for key in (*_COMMON, *signatures)}
        self.handle: int = self._functions["open"]()
        self.io: Any = io_type.from_address(self.call("io"))

    def function(self, name: str) -> Any:
        """Return the library's function of that name."""
        return getattr(self._library, f"{self._name}_{name}")

    def call(self, name: str, *arguments: Any) -> Any:
        """Call a function of the library on this board."""
        return self._functions[name](self.handle, *arguments)

    def boot(self, reset_cause: int) -> None:
        """Boot with these bits in the chip's MCUSR; the EEPROM persists."""
        self.call("boot", reset_cause)

    def close(self) -> None:
        """Free the board; a second call does nothing."""
        if self.handle:
            self.call("close")
        self.handle = 0


def _load(
    board: str, io_type: type[ctypes.Structure], signatures: Signatures, path: Path | None
) -> ctypes.PyDLL:
    """Return a board's library. Raises RigFault if it is missing, stale, or for another system."""
    root = checkout()
    file = path or (
        dynamic_library_path(board) if root else installed_library(dynamic_library_name(board))
    )
    if not file.is_file():
        raise RigFault(f"{file}: the virtual {board} board is not compiled: {CURE}{COMMAND}")
    try:
        # PyDLL: calls are short, so releasing the GIL for each would cost more than it gains.
        library = ctypes.PyDLL(str(file))
        built_from = _constant(library, f"{board}_sources", ctypes.c_char_p).decode()
        stale = root is not None and built_from != _sources_digest(board)
        stale = stale or _constant(library, f"{board}_io_size", U64) != ctypes.sizeof(io_type)
    except (OSError, AttributeError) as error:
        raise RigFault(
            f"{file}: the virtual {board} board was not made for this system ({error}): "
            f"delete it, {CURE}{COMMAND}"
        ) from error
    if stale:
        raise RigFault(
            f"{file}: the virtual {board} board was made of other sources than arduino/ holds: "
            f"run {COMMAND}"
        )
    for name, (result, arguments) in signatures.items():
        function = getattr(library, f"{board}_{name}")
        function.restype, function.argtypes = result, arguments
    return library


@cache
def _sources_digest(board: str) -> str:
    # Reading a hundred files takes as long as a second of simulated time.
    return digest(board)


def _constant(library: ctypes.PyDLL, name: str, result: Any) -> Any:
    function = getattr(library, name)
    function.restype, function.argtypes = result, []
    return function()
