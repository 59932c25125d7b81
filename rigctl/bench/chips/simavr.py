"""Python binding of the compiled shim around simavr (``arduino/sim``).

The layout of a chip's inputs and outputs is parsed from ``arduino/sim/sim.h``; its size is checked
when the library is loaded. Calls release the GIL. Use a chip in one thread at a time.
"""

from __future__ import annotations

import ctypes
import re
from enum import IntEnum
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.config.intel_hex import parse_intel_hex
from rigctl.config.resources import checkout
from rigctl.errors import RigFault, WrongUse

CHANNELS = 18
MAX_BYTES = 4096
MAX_INPUTS = 1024
MAX_ROWS = 33


class Kind(IntEnum):
    """Kind of board, which determines chip and wiring."""

    DRUM = 0
    TAXELS = 1


FLASH_BYTES = {Kind.DRUM: 0x40000, Kind.TAXELS: 0x8000}


class Output(IntEnum):
    """Signals whose edges are reported; for STEP only rising edges."""

    STEP = 0
    DIR = 1
    ENABLE = 2
    SYNC = 3
    BRIDGE = 4
    SCK = 5
    INDEX = 6
    SAMPLE = 7


class Input(IntEnum):
    """Input pins that a caller may set at a cycle."""

    ESTOP = 0
    END_UP = 1
    END_DOWN = 2
    INDEX = 3
    SYNC = 4
    MARK = 5


class ResetBy(IntEnum):
    """Cause of a reset; only POWER clears the SRAM."""

    POWER = 1
    PIN = 2
    BROWN_OUT = 4


_U64, _U8 = ctypes.c_uint64, ctypes.c_uint8
_TYPES: dict[str, Any] = {
    "double": ctypes.c_double,
    "int32_t": ctypes.c_int32,
    "int64_t": ctypes.c_int64,
    "uint64_t": _U64,
    "uint8_t": _U8,
}


@cache
def io_type() -> type[ctypes.Structure]:
    """Return ``sim_io`` as declared and documented in ``arduino/sim/sim.h``.

    Raises RigFault outside of a checkout.
    """
    root = checkout()
    if root is None:
        raise RigFault("simulated chips need a checkout: use --rig virtual")
    text = re.sub(r"/\*.*?\*/", "", (root / "arduino/sim/sim.h").read_text(), flags=re.DOTALL)
    sizes = {name: int(size) for name, size in re.findall(r"#define (\w+) (\d+)", text)}
    body = text.split("typedef struct sim_io {")[1].split("} sim_io;")[0]
    fields = []
    for kind, names in re.findall(r"(\w+) ([^;]+);", body):
        for name, bounds in re.findall(r"(\w+)((?:\[\w+\])*)", names):
            type_: Any = _TYPES[kind]
            for bound in reversed(re.findall(r"\w+", bounds)):
                type_ = type_ * sizes[bound]
            fields.append((name, type_))
    return type("SimIO", (ctypes.Structure,), {"_fields_": fields})


_POINTER, _SIZE = ctypes.c_void_p, ctypes.c_uint32
_SIGNATURES: dict[str, tuple[Any, list[Any]]] = {
    "sim_open": (_POINTER, [ctypes.c_char_p, ctypes.c_int]),
    "sim_close": (None, [_POINTER]),
    "sim_io_of": (_POINTER, [_POINTER]),
    "sim_io_size": (ctypes.c_ulong, []),
    "sim_run": (ctypes.c_int, [_POINTER, _U64]),
    "sim_reset": (None, [_POINTER, ctypes.c_int]),
    "sim_flash_read": (ctypes.c_int, [_POINTER, _SIZE, ctypes.c_char_p, _SIZE]),
    "sim_flash_write": (ctypes.c_int, [_POINTER, _SIZE, ctypes.c_char_p, _SIZE]),
    "sim_start_at": (None, [_POINTER, _SIZE]),
    "sim_place_drum": (None, [_POINTER, ctypes.c_int64]),
    "sim_eeprom_read": (ctypes.c_int, [_POINTER, _SIZE, ctypes.c_char_p, _SIZE]),
    "sim_eeprom_write": (ctypes.c_int, [_POINTER, _SIZE, ctypes.c_char_p, _SIZE]),
}


def load_library(path: Path) -> ctypes.CDLL:
    """Load the shim. Raises RigFault if it is missing or of another version than this file."""
    try:
        library = ctypes.CDLL(str(path))
        for name, (result, arguments) in _SIGNATURES.items():
            function = getattr(library, name)
            function.restype, function.argtypes = result, arguments
    except (OSError, AttributeError) as error:
        raise RigFault(
            f"{path}: the chip simulator cannot be loaded ({error}): run `make firmware`"
        ) from error
    if library.sim_io_size() != ctypes.sizeof(io_type()):
        raise RigFault(f"{path}: the chip simulator is of another version: run `make firmware`")
    return library


class Chip:
    """One simulated AVR with its image. Close it; nothing else frees the simulator's memory.

    The arrays are views of ``io``: ``tx``, ``tx_cycle``, ``edge_cycle``, ``edge_signal``,
    ``edge_level`` (valid up to their counts, until the next :meth:`run`); ``analog`` float64
    (33, 18), from the start to the end of the run: conductances of the taxels in units of the
    divider's, for the drum shares of the reference; ``noise``, the same in ADC codes. With a
    ``bootloader``, an Intel HEX file, every reset starts there.
    """

    def __init__(
        self, library: ctypes.CDLL, image: Path, kind: Kind, bootloader: Path | None = None
    ) -> None:
        self._library = library
        self._handle = library.sim_open(str(image).encode(), int(kind)) if image.is_file() else None
        if not self._handle:
            raise RigFault(f"{image}: no firmware image to run: run `make firmware`")
        self.io: Any = io_type().from_address(library.sim_io_of(self._handle))
        self._map_arrays()
        if bootloader is not None:
            self._add_bootloader(bootloader, FLASH_BYTES[kind])

    def _add_bootloader(self, path: Path, flash_bytes: int) -> None:
        segments = parse_intel_hex(path.read_text())
        for address, data in segments:
            # Debian's Optiboot is 20 bytes longer than its room; calls to them wrap to the start of
            # the flash, on a chip and here.
            self.write_flash(address, data[: flash_bytes - address])
        self._library.sim_start_at(self._handle, segments[0][0])
        self.reset(ResetBy.POWER)
        self.io.resets = 0

    def _map_arrays(self) -> None:
        self.tx = self._view("tx", np.uint8)
        self.tx_cycle = self._view("tx_cycle", np.uint64)
        self.edge_cycle = self._view("edge_cycle", np.uint64)
        self.edge_signal = self._view("edge_signal", np.uint8)
        self.edge_level = self._view("edge_level", np.uint8)
        self.analog = self._view("analog", np.float64).reshape(MAX_ROWS, CHANNELS)
        self.noise = self._view("analog_noise", np.float64).reshape(MAX_ROWS, CHANNELS)
        self._rx = self._view("rx", np.uint8)

    def _view(self, field: str, dtype: type[np.generic]) -> NDArray[Any]:
        return np.frombuffer(getattr(self.io, field), dtype)

    def send(self, data: bytes, from_cycle: int = 0) -> int:
        """Pass bytes from the host to the next run; return how many fit."""
        taken = min(len(data), MAX_BYTES)
        self.io.rx_start = from_cycle
        self._rx[:taken] = np.frombuffer(data[:taken], np.uint8)
        self.io.rx_count = taken
        return taken

    def set_input(self, signal: Input, cycle: int, level: int) -> None:
        """Change a pin at a cycle of the next run; cycles must ascend."""
        io = self.io
        if io.input_count >= MAX_INPUTS:
            raise WrongUse("too many pin changes in one slice: run shorter slices")
        io.input_cycle[io.input_count] = cycle
        io.input_signal[io.input_count] = int(signal)
        io.input_level[io.input_count] = level
        io.input_count += 1

    def run(self, until_cycle: int) -> None:
        """Run to a cycle. Raises RigFault if the chip is closed or the simulator stops."""
        if not self._handle:
            raise RigFault("the simulated chip is closed")
        if self._library.sim_run(self._handle, until_cycle):
            raise RigFault(f"the simulated chip stopped at cycle {self.io.cycle}")

    def reset(self, by: ResetBy = ResetBy.PIN) -> None:
        """Reset the chip; EEPROM and flash persist."""
        self._library.sim_reset(self._handle, int(by))

    def read_flash(self, offset: int, size: int) -> bytes:
        """Read bytes of the program. Raises WrongUse outside of the flash."""
        buffer = ctypes.create_string_buffer(size)
        if self._library.sim_flash_read(self._handle, offset, buffer, size):
            raise WrongUse(f"the flash has no bytes {offset} … {offset + size - 1}")
        return buffer.raw

    def write_flash(self, offset: int, data: bytes) -> None:
        """Write bytes of the program as a programmer does. Raises WrongUse outside of the flash."""
        if self._library.sim_flash_write(self._handle, offset, data, len(data)):
            raise WrongUse(f"the flash has no bytes {offset} … {offset + len(data) - 1}")

    def place_drum(self, steps: int) -> None:
        """Turn the drum to ``steps`` behind the start of its index mark."""
        self._library.sim_place_drum(self._handle, steps)

    def read_eeprom(self, offset: int, size: int) -> bytes:
        """Read bytes of the EEPROM. Raises WrongUse outside of it."""
        buffer = ctypes.create_string_buffer(size)
        if self._library.sim_eeprom_read(self._handle, offset, buffer, size):
            raise WrongUse(f"EEPROM has no bytes {offset} … {offset + size - 1}")
        return buffer.raw

    def write_eeprom(self, offset: int, data: bytes) -> None:
        """Write bytes of the EEPROM. Raises WrongUse outside of it."""
        if self._library.sim_eeprom_write(self._handle, offset, data, len(data)):
            raise WrongUse(f"EEPROM has no bytes {offset} … {offset + len(data) - 1}")

    def close(self) -> None:
        """Free the simulator's memory; a second call does nothing. ``io`` remains readable."""
        if self._handle:
            self.io = io_type().from_buffer_copy(self.io)
            self._map_arrays()
            self._library.sim_close(self._handle)
            self._handle = None
