"""The taxel board's firmware in this process.

:class:`TaxelIO` mirrors ``arduino/host/taxels/taxel_io.h``.
"""

from __future__ import annotations

import ctypes
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.simulation.boards.firmware_library import I32, I64, POINTER, FirmwareLibrary
from rigctl.values import N_TAXELS

MAX_FRAMES, MAX_BYTES = 4096, 65536
SYNC, INDEX = 0, 1


class TaxelIO(ctypes.Structure):
    """Inputs and outputs of the board."""

    _fields_ = (
        ("supply_mv", I64),
        ("tx_count", I64),
        ("overflows", I64),
        ("readings", ctypes.c_uint16 * N_TAXELS * MAX_FRAMES),
        ("flags", ctypes.c_uint8 * MAX_FRAMES),
        ("edges", ctypes.c_uint8 * MAX_FRAMES),
        ("tx", ctypes.c_uint8 * MAX_BYTES),
    )


_SIGNATURES: dict[str, tuple[Any, list[Any]]] = {
    "run": (None, [POINTER, I32]),
    "close_frames": (None, [POINTER, I32]),
    "edge": (None, [POINTER, I32, I32, I64]),
    "receive": (None, [POINTER, ctypes.c_char_p, I32]),
}


class TaxelFirmware(FirmwareLibrary):
    """One taxel board; cycles count from the start of its first frame.

    Raises RigFault if its library cannot be used.
    """

    def __init__(self, library: Path | None = None) -> None:
        super().__init__("taxels", TaxelIO, _SIGNATURES, library)
        self._readings = np.ctypeslib.as_array(self.io.readings)
        self._flags = np.ctypeslib.as_array(self.io.flags)
        self._edges = np.ctypeslib.as_array(self.io.edges)

    def edge(self, signal: int, level: int, cycle: int) -> None:
        """Pass an edge of SYNC or INDEX; its frame must not be closed yet."""
        self.call("edge", signal, level, cycle)

    def receive(self, data: bytes) -> None:
        """Pass bytes from the host; the board reads them in its next frame."""
        self.call("receive", data, len(data))

    def run(self, readings: NDArray[np.uint16]) -> None:
        """Close and send frames with these readings, uint16 (n, 18), n ≤ MAX_FRAMES."""
        self._readings[: len(readings)] = readings
        self.call("run", len(readings))

    def close_frames(self, count: int) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        """Close frames without sending; return their flags and edges, uint8 (count,) each."""
        flags, edges = [], []
        for first in range(0, count, MAX_FRAMES):
            part = min(MAX_FRAMES, count - first)
            self.call("close_frames", part)
            flags.append(self._flags[:part].copy())
            edges.append(self._edges[:part].copy())
        nothing = [np.zeros(0, np.uint8)]
        return np.concatenate(flags or nothing), np.concatenate(edges or nothing)

    def take_sent(self) -> bytes:
        """Return the bytes sent since the last call."""
        count = self.io.tx_count
        self.io.tx_count = 0
        return ctypes.string_at(ctypes.addressof(self.io.tx), count)
