"""The finger board's firmware in this process.

:class:`FingerIO` mirrors ``arduino/host/finger/finger_io.h``.
"""

from __future__ import annotations

import ctypes
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.bench.boards.firmware_library import I32, I64, POINTER, FirmwareLibrary
from rigctl.finger.board_messages import N_TAXELS

MAX_SAMPLES, MAX_BYTES = 4096, 262144


class FingerIO(ctypes.Structure):
    """Inputs and outputs of the board."""

    _fields_ = (
        ("tx_count", I64),
        ("overflows", I64),
        ("readings", ctypes.c_uint16 * N_TAXELS * MAX_SAMPLES),
        ("tx", ctypes.c_uint8 * MAX_BYTES),
    )


_SIGNATURES: dict[str, tuple[Any, list[Any]]] = {
    "run": (None, [POINTER, I32]),
    "receive": (None, [POINTER, ctypes.c_char_p, I32]),
    "receive_taxels": (None, [POINTER, ctypes.c_char_p, I32]),
}


class FingerFirmware(FirmwareLibrary):
    """One finger board; its clock is its samples. Raises RigFault if its library is unusable."""

    def __init__(self, library: Path | None = None) -> None:
        super().__init__("finger", FingerIO, _SIGNATURES, library)
        self._readings = np.ctypeslib.as_array(self.io.readings)

    def receive(self, data: bytes) -> None:
        """Pass bytes from the host; the board handles them at once."""
        self.call("receive", data, len(data))

    def receive_taxels(self, data: bytes) -> None:
        """Pass bytes from the taxel board."""
        self.call("receive_taxels", data, len(data))

    def run(self, readings: NDArray[np.uint16]) -> None:
        """Pass samples of the board's own converter, uint16 (n, 9), n ≤ MAX_SAMPLES."""
        self._readings[: len(readings)] = readings
        self.call("run", len(readings))

    def take_sent(self) -> bytes:
        """Return the bytes sent since the last call."""
        count = self.io.tx_count
        self.io.tx_count = 0
        return ctypes.string_at(ctypes.addressof(self.io.tx), count)
