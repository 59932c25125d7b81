"""The finger board in its two wirings: its own converter, or the taxel board's line."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rigctl.bench.boards.taxels import TaxelFirmware
from rigctl.finger.bench.firmware import FingerFirmware
from rigctl.finger.bench.skin import TOP_LAYER

POWER_ON = 1


class FingerBoard(Protocol):
    """A finger board whose clock is its samples."""

    def boot(self) -> None:
        """Boot, as after power-up."""

    def receive(self, data: bytes) -> None:
        """Pass bytes from the host; the board handles them at once."""

    def run(self, readings: NDArray[np.uint16]) -> None:
        """Pass samples, uint16 (n, 18), in the order of the taxel board's wire."""

    def take_sent(self) -> bytes:
        """Return the bytes sent to the host since the last call."""

    def close(self) -> None:
        """Free the board; a second call does nothing."""


class ConverterBoard:
    """The finger board that reads the nine taxels of the top layer with its own converter."""

    def __init__(self) -> None:
        self._firmware = FingerFirmware()

    def boot(self) -> None:
        self._firmware.boot(POWER_ON)

    def receive(self, data: bytes) -> None:
        self._firmware.receive(data)

    def run(self, readings: NDArray[np.uint16]) -> None:
        self._firmware.run(readings[:, TOP_LAYER])

    def take_sent(self) -> bytes:
        return self._firmware.take_sent()

    def close(self) -> None:
        self._firmware.close()


class TaxelLineBoard:
    """The finger board behind the taxel board's firmware, which sends it all 18 readings.

    Both boards boot together. Their line is whole.
    """

    def __init__(self) -> None:
        self._firmware = FingerFirmware()
        self._taxels = TaxelFirmware()

    def boot(self) -> None:
        self._taxels.boot(POWER_ON)
        self._taxels.take_sent()
        self._firmware.boot(POWER_ON)

    def receive(self, data: bytes) -> None:
        self._firmware.receive(data)

    def run(self, readings: NDArray[np.uint16]) -> None:
        self._taxels.run(readings)
        self._firmware.receive_taxels(self._taxels.take_sent())

    def take_sent(self) -> bytes:
        return self._firmware.take_sent()

    def close(self) -> None:
        self._firmware.close()
        self._taxels.close()
