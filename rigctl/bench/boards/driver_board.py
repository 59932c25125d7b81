"""A sensor's board of a driver from outside on the bench: it sends what the driver encodes."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
from numpy.typing import NDArray

from rigctl.boards.sensor_driver import SensorDriver, SimulatedSensor
from rigctl.config.rig_config import ADC_MAX
from rigctl.errors import ConfigError, RigFault

SYNC, CYCLES_PER_FRAME = 0, 16_000


class DriverBoard:
    """Stands where :class:`~rigctl.bench.boards.taxels.TaxelFirmware` does; no firmware runs.

    Raises ConfigError for a driver without ``encode``.
    """

    def __init__(self, driver: SensorDriver) -> None:
        if not hasattr(driver.create, "encode"):
            raise ConfigError(
                f"the {driver.plugin} cannot be rehearsed, it has no encode: leave [ports] "
                "simulate out, or ask its author"
            )
        self.io = SimpleNamespace(supply_mv=0)
        self._plugin = driver.plugin
        self._full_scale = driver.create.full_scale
        with self._plugin.blamed():
            self._sensor = cast(SimulatedSensor, driver.create())
        self.boot(0)

    def boot(self, reset_cause: int) -> None:
        """Begin with sample 0."""
        self._next = 0
        self._level = False
        self._edges: list[tuple[int, bool]] = []
        self._sent = b""

    def edge(self, signal: int, level: int, cycle: int) -> None:
        """Pass an edge of the sync line; the index mark is not wired to this board."""
        if signal == SYNC:
            self._edges.append((cycle // CYCLES_PER_FRAME, bool(level)))

    def receive(self, data: bytes) -> None:
        """Ignore a request: the board sends by itself."""

    def run(self, readings: NDArray[np.uint16]) -> None:
        """Send samples of these readings, uint16 (n, n_taxels), 0 to 1023. Raises RigFault."""
        numbers = np.arange(self._next, self._next + len(readings), dtype=np.int64)
        samples = readings.astype(np.int64) * self._full_scale // ADC_MAX
        levels = self._levels(len(readings))
        with self._plugin.blamed(RigFault):
            self._sent += self._sensor.encode(numbers, samples.astype(np.uint16), levels)
        self._next += len(readings)

    def take_sent(self) -> bytes:
        """Return the bytes sent since the last call."""
        sent, self._sent = self._sent, b""
        return sent

    def close(self) -> None:
        """Do nothing: there is no library to free."""

    def _levels(self, count: int) -> NDArray[np.bool_]:
        """Return the level of sync at the end of each of the next samples, bool (count,)."""
        levels = np.full(count, self._level)
        while self._edges and self._edges[0][0] < self._next + count:
            frame, level = self._edges.pop(0)
            levels[max(0, frame - self._next) :] = self._level = level
        return levels
