"""The compiled shim around simavr (``arduino/sim``) as Python sees it: one exchange per slice.

Structures mirror ``arduino/sim/sim.h``; the size of the exchange is compared when the library
is loaded. Calls release the interpreter's lock. A chip belongs to one thread at a time.
"""

from __future__ import annotations

import ctypes
from enum import IntEnum
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.errors import RigFault, WrongUse

CHANNELS = 18
MAX_BYTES = 4096
MAX_EDGES = 8192
MAX_INPUTS = 1024
VECTORS = 64
MAX_ROWS = 33


class Kind(IntEnum):
    """Which board, and so which chip and which wiring."""

    DRUM = 0
    TAXELS = 1


class Output(IntEnum):
    """Signals whose edges are reported; of STEP only rises."""

    STEP = 0
    DIR = 1
    ENABLE = 2
    SYNC = 3
    BRIDGE = 4
    SCK = 5
    INDEX = 6
    SAMPLE = 7


class Input(IntEnum):
    """Pins that a caller may set at a cycle."""

    ESTOP = 0
    END_UP = 1
    END_DOWN = 2
    INDEX = 3
    SYNC = 4


class ResetBy(IntEnum):
    """What resets a chip; SRAM is lost only with the power."""

    POWER = 1
    PIN = 2


_I32, _I64, _U64, _U8 = ctypes.c_int32, ctypes.c_int64, ctypes.c_uint64, ctypes.c_uint8


class Exchange(ctypes.Structure):
    """``sim_exchange`` of ``sim.h``; the meanings stand there."""

    _fields_ = (
        ("analog", ctypes.c_double * CHANNELS * MAX_ROWS),
        ("analog_noise", ctypes.c_double * CHANNELS * MAX_ROWS),
        ("loadcell_period_q16", _I64),
        ("host_byte_q16", _I64),
        ("loadcell_counts", _I32),
        ("loadcell_mode", _I32),
        ("motor_jammed", _I32),
        ("mark_length_steps", _I32),
        ("mark_inverted", _I32),
        ("enable_high", _I32),
        ("port_a_first", _I32),
        ("steps_per_turn", _I32),
        ("report_samples", _I32),
        ("report_steps", _I32),
        ("analog_rows", _I32),
        ("watch_interrupts", _I32),
        ("lines_low", _I32),
        ("lines_high", _I32),
        ("lines_together", _I32),
        ("inputs_low", _I32),
        ("inputs_high", _I32),
        ("inputs_together", _I32),
        ("inputs_open", _I32),
        ("driven_low", _I32),
        ("rx_count", _I32),
        ("input_count", _I32),
        ("rx_start", _U64),
        ("input_cycle", _U64 * MAX_INPUTS),
        ("input_signal", _U8 * MAX_INPUTS),
        ("input_level", _U8 * MAX_INPUTS),
        ("rx", _U8 * MAX_BYTES),
        ("tx_cycle", _U64 * MAX_BYTES),
        ("tx", _U8 * MAX_BYTES),
        ("edge_cycle", _U64 * MAX_EDGES),
        ("edge_signal", _U8 * MAX_EDGES),
        ("edge_level", _U8 * MAX_EDGES),
        ("tx_count", _I32),
        ("edge_count", _I32),
        ("cycle", _U64),
        ("drive", ctypes.c_double),
        ("drum_steps", _I64),
        ("drum_place", ctypes.c_double),
        ("loadcell_ready", _U64),
        ("resets", _U64),
        ("rx_overruns", _U64),
        ("rx_latency", _U64),
        ("overflows", _U64),
        ("slept_cycles", _U64),
        ("isr_cycles", _U64),
        ("isr_count", _U64),
        ("longest_isr", _U64 * VECTORS),
        ("loadcell_conversions", _U64),
        ("loadcell_reads", _U64),
        ("longest_read", _U64),
        ("loadcell_latency", _U64),
        ("longest_off", _U64),
    )


_POINTER, _SIZE = ctypes.c_void_p, ctypes.c_uint32
_SIGNATURES: dict[str, tuple[Any, list[Any]]] = {
    "sim_open": (_POINTER, [ctypes.c_char_p, ctypes.c_int]),
    "sim_close": (None, [_POINTER]),
    "sim_exchange_of": (_POINTER, [_POINTER]),
    "sim_exchange_size": (ctypes.c_ulong, []),
    "sim_run": (ctypes.c_int, [_POINTER, _U64]),
    "sim_reset": (None, [_POINTER, ctypes.c_int]),
    "sim_place_drum": (None, [_POINTER, _I64]),
    "sim_eeprom_read": (ctypes.c_int, [_POINTER, _SIZE, ctypes.c_char_p, _SIZE]),
    "sim_eeprom_write": (ctypes.c_int, [_POINTER, _SIZE, ctypes.c_char_p, _SIZE]),
    "sim_peek": (_U8, [_POINTER, _SIZE]),
}


def load_library(path: Path) -> ctypes.CDLL:
    """Load the shim. Raises RigFault when it is missing or of another version than this file."""
    try:
        library = ctypes.CDLL(str(path))
    except OSError as error:
        raise RigFault(
            f"{path}: the chip simulator cannot be loaded ({error}): run `make firmware`"
        ) from error
    for name, (result, arguments) in _SIGNATURES.items():
        function = getattr(library, name)
        function.restype, function.argtypes = result, arguments
    if library.sim_exchange_size() != ctypes.sizeof(Exchange):
        raise RigFault(f"{path}: the chip simulator is of another version: run `make firmware`")
    return library


class Chip:
    """One simulated AVR with its image. Close it; nothing else frees the simulator's memory.

    Arrays are views of the exchange: ``tx``, ``tx_cycle``, ``edge_cycle``, ``edge_signal``,
    ``edge_level`` (valid up to the counts, until the next :meth:`run`); ``analog`` float64
    (33, 18), shares of the reference at the start of the run, …, at its end; ``noise`` the same
    in codes.
    """

    def __init__(self, library: ctypes.CDLL, image: Path, kind: Kind) -> None:
        self._library = library
        self._handle = library.sim_open(str(image).encode(), int(kind)) if image.is_file() else None
        if not self._handle:
            raise RigFault(f"{image}: no firmware image to run: run `make firmware`")
        self.exchange = Exchange.from_address(library.sim_exchange_of(self._handle))
        self._map_exchange()

    def _map_exchange(self) -> None:
        self.tx = self._view("tx", np.uint8)
        self.tx_cycle = self._view("tx_cycle", np.uint64)
        self.edge_cycle = self._view("edge_cycle", np.uint64)
        self.edge_signal = self._view("edge_signal", np.uint8)
        self.edge_level = self._view("edge_level", np.uint8)
        self.analog = self._view("analog", np.float64).reshape(MAX_ROWS, CHANNELS)
        self.noise = self._view("analog_noise", np.float64).reshape(MAX_ROWS, CHANNELS)
        self._rx = self._view("rx", np.uint8)

    def _view(self, field: str, dtype: type[np.generic]) -> NDArray[Any]:
        return np.frombuffer(getattr(self.exchange, field), dtype)

    def send(self, data: bytes, from_cycle: int = 0) -> int:
        """Hand bytes of the host over for the next run; returns how many fit."""
        taken = min(len(data), MAX_BYTES)
        self.exchange.rx_start = from_cycle
        self._rx[:taken] = np.frombuffer(data[:taken], np.uint8)
        self.exchange.rx_count = taken
        return taken

    def set_input(self, signal: Input, cycle: int, level: int) -> None:
        """Have a pin change at a cycle of the next run; cycles must ascend."""
        x = self.exchange
        if x.input_count >= MAX_INPUTS:
            raise WrongUse("too many pin changes in one slice: run shorter slices")
        x.input_cycle[x.input_count] = cycle
        x.input_signal[x.input_count] = int(signal)
        x.input_level[x.input_count] = level
        x.input_count += 1

    def run(self, until_cycle: int) -> None:
        """Run to a cycle. Raises RigFault when closed, or when the chip did the impossible."""
        if not self._handle:
            raise RigFault("the simulated chip is closed")
        if self._library.sim_run(self._handle, until_cycle):
            raise RigFault(f"the simulated chip stopped at cycle {self.exchange.cycle}")

    def reset(self, by: ResetBy = ResetBy.PIN) -> None:
        """Reset the chip; EEPROM is kept."""
        self._library.sim_reset(self._handle, int(by))

    def place_drum(self, steps: int) -> None:
        """Turn the drum to ``steps`` behind the start of its index mark."""
        self._library.sim_place_drum(self._handle, steps)

    def read_eeprom(self, offset: int, size: int) -> bytes:
        """Bytes of the EEPROM. Raises WrongUse outside of it."""
        buffer = ctypes.create_string_buffer(size)
        if self._library.sim_eeprom_read(self._handle, offset, buffer, size):
            raise WrongUse(f"EEPROM has no bytes {offset} … {offset + size - 1}")
        return buffer.raw

    def write_eeprom(self, offset: int, data: bytes) -> None:
        """Change bytes of the EEPROM. Raises WrongUse outside of it."""
        if self._library.sim_eeprom_write(self._handle, offset, data, len(data)):
            raise WrongUse(f"EEPROM has no bytes {offset} … {offset + len(data) - 1}")

    def peek(self, address: int) -> int:
        """One byte of data memory: registers, I/O, SRAM."""
        return int(self._library.sim_peek(self._handle, address))

    def close(self) -> None:
        """Free the simulator's memory; harmless when closed already. Counters can still be read."""
        if self._handle:
            self.exchange = Exchange.from_buffer_copy(self.exchange)
            self._map_exchange()
            self._library.sim_close(self._handle)
            self._handle = None
