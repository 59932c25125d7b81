"""The taxel board's firmware in this process: one virtual board.

:class:`TaxelExchange` mirrors ``arduino/host/taxels/exchange.h``.
"""

from __future__ import annotations

import ctypes
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.simulation.boards.library import I32, I64, POINTER, FirmwareLibrary
from rigctl.values import N_TAXELS

MOST_FRAMES, MOST_BYTES = 4096, 65536
SYNC, INDEX = 0, 1


class TaxelExchange(ctypes.Structure):
    """What bench and board tell each other between two runs."""

    _fields_ = (
        ("tx_count", I64),
        ("sent_at", I64),
        ("overflows", I64),
        ("readings", ctypes.c_uint16 * N_TAXELS * MOST_FRAMES),
        ("flags", ctypes.c_uint8 * MOST_FRAMES),
        ("edges", ctypes.c_uint8 * MOST_FRAMES),
        ("tx", ctypes.c_uint8 * MOST_BYTES),
    )


_SIGNATURES: dict[str, tuple[Any, list[Any]]] = {
    "run": (None, [POINTER, I32]),
    "close_frames": (None, [POINTER, I32]),
    "edge": (None, [POINTER, I32, I32, I64]),
    "receive": (None, [POINTER, ctypes.c_char_p, I32]),
}


class TaxelFirmware(FirmwareLibrary):
    """One taxel board.

    Cycles count from the start of its first frame. Raises RigFault where its library cannot be
    used.
    """

    def __init__(self, library: Path | None = None) -> None:
        super().__init__("taxels", TaxelExchange, _SIGNATURES, library)
        self._readings = np.ctypeslib.as_array(self.exchange.readings)
        self._flags = np.ctypeslib.as_array(self.exchange.flags)
        self._edges = np.ctypeslib.as_array(self.exchange.edges)

    def edge(self, signal: int, level: int, cycle: int) -> None:
        """Tell of an edge of SYNC or INDEX, before the frame in which it falls is closed."""
        self.call("edge", signal, level, cycle)

    def receive(self, data: bytes) -> None:
        """Hand over bytes of the host; the board looks at them with its next frame."""
        self.call("receive", data, len(data))

    def run(self, readings: NDArray[np.uint16]) -> None:
        """Close and send frames with these readings, uint16 (n, 18), n ≤ MOST_FRAMES."""
        self._readings[: len(readings)] = readings
        self.call("run", len(readings))

    def pass_frames(self, count: int) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        """Close frames that are not sent; returns their flags and edges, uint8 (count,) each."""
        flags, edges = [], []
        for first in range(0, count, MOST_FRAMES):
            part = min(MOST_FRAMES, count - first)
            self.call("close_frames", part)
            flags.append(self._flags[:part].copy())
            edges.append(self._edges[:part].copy())
        nothing = [np.zeros(0, np.uint8)]
        return np.concatenate(flags or nothing), np.concatenate(edges or nothing)

    def take_sent(self) -> bytes:
        """Return what was sent since the last call."""
        count = self.exchange.tx_count
        self.exchange.tx_count = 0
        return ctypes.string_at(ctypes.addressof(self.exchange.tx), count)
