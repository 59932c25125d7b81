"""Loads the boards' firmware that was compiled for this computer, and refuses any other."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rigctl.config.resources import checkout, installed_library
from rigctl.errors import RigFault
from rigctl.host_build import COMMAND, CURE, digest, dynamic_library_name, dynamic_library_path

# Calls are short: letting go of the interpreter for each would cost more than it gives.
Signatures = Mapping[str, tuple[Any, list[Any]]]
POINTER = ctypes.c_void_p
I32, I64, U64 = ctypes.c_int32, ctypes.c_int64, ctypes.c_uint64


_COMMON: Signatures = {
    "open": (POINTER, []),
    "close": (None, [POINTER]),
    "exchange": (POINTER, [POINTER]),
    "boot": (None, [POINTER, I32]),
}


class FirmwareLibrary:
    """One board in this process. Close it; nothing else frees its memory.

    ``name`` is ``drum`` or ``taxels``; ``exchange`` is what bench and board tell each other.
    Raises RigFault where its library, at ``path`` or where it is built, cannot be used.
    """

    def __init__(
        self,
        name: str,
        exchange: type[ctypes.Structure],
        signatures: Signatures,
        path: Path | None = None,
    ) -> None:
        self._name = name
        self._dll = _load(name, exchange, {**_COMMON, **signatures}, path)
        self.handle: int = self.function("open")()
        self.exchange: Any = exchange.from_address(self.call("exchange"))

    def function(self, name: str) -> Any:
        """The library's function of that name."""
        return getattr(self._dll, f"{self._name}_{name}")

    def call(self, name: str, *arguments: Any) -> Any:
        """Have the board do what a function of its library says."""
        return self.function(name)(self.handle, *arguments)

    def boot(self, reset_cause: int) -> None:
        """Start anew after a reset, with the bits of the chip's MCUSR; EEPROM is kept."""
        self.call("boot", reset_cause)

    def close(self) -> None:
        """Free the board; harmless when done already."""
        if self.handle:
            self.call("close")
        self.handle = 0


def _load(
    board: str, exchange: type[ctypes.Structure], signatures: Signatures, path: Path | None = None
) -> ctypes.PyDLL:
    """Return the library of ``drum`` or ``taxels``, at ``path`` or where it is built.

    Raises RigFault where it is missing, stale, or made for another system.
    """
    root = checkout()
    place = path or (
        dynamic_library_path(board) if root else installed_library(dynamic_library_name(board))
    )
    if not place.is_file():
        raise RigFault(f"{place}: the virtual {board} board is not compiled: {CURE}{COMMAND}")
    try:
        library = ctypes.PyDLL(str(place))
        size = _declared(library, f"{board}_exchange_size", U64)
        made_of = _declared(library, f"{board}_sources", ctypes.c_char_p).decode()
    except (OSError, AttributeError) as error:
        raise RigFault(
            f"{place}: the virtual {board} board was not made for this system ({error}): "
            f"delete it, {CURE}{COMMAND}"
        ) from error
    if size != ctypes.sizeof(exchange) or (root is not None and made_of != digest(board)):
        raise RigFault(
            f"{place}: the virtual {board} board was made of other sources than arduino/ holds: "
            f"run {COMMAND}"
        )
    for name, (result, arguments) in signatures.items():
        function = getattr(library, f"{board}_{name}")
        function.restype, function.argtypes = result, arguments
    return library


def _declared(library: ctypes.PyDLL, name: str, result: Any) -> Any:
    function = getattr(library, name)
    function.restype, function.argtypes = result, []
    return function()
