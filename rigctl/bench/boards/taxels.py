"""The virtual taxel board on the bench: frame timing and readings."""

from __future__ import annotations

import ctypes
import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.bench.bench import Bench
from rigctl.bench.boards.driver_board import DriverBoard
from rigctl.bench.boards.firmware_library import I32, I64, POINTER, FirmwareLibrary
from rigctl.bench.skin import SLOT_US
from rigctl.config.rig_config import TaxelArray
from rigctl.errors import ConfigError, RigFault
from rigctl.host_build import COMMAND

MAX_FRAMES, MAX_BYTES = 4096, 65536
SYNC, INDEX = 0, 1


class TaxelIO(ctypes.Structure):
    """Inputs and outputs of the board."""

    _fields_ = (
        ("supply_mv", I64),
        ("tx_count", I64),
        ("overflows", I64),
        ("flags", ctypes.c_uint8 * MAX_FRAMES),
        ("edges", ctypes.c_uint8 * MAX_FRAMES),
        ("tx", ctypes.c_uint8 * MAX_BYTES),
    )


_SIGNATURES: dict[str, tuple[Any, list[Any]]] = {
    "lines": (I32, []),
    "inputs": (I32, []),
    "run": (None, [POINTER, POINTER, I32]),
    "close_frames": (None, [POINTER, I32]),
    "edge": (None, [POINTER, I32, I32, I64]),
    "receive": (None, [POINTER, ctypes.c_char_p, I32]),
}


class TaxelFirmware(FirmwareLibrary):
    """One taxel board; cycles count from the start of its first frame.

    ``lines`` and ``inputs`` are those that it was compiled for. Raises RigFault if its library
    cannot be used.
    """

    def __init__(self, library: Path | None = None) -> None:
        super().__init__("taxels", TaxelIO, _SIGNATURES, library)
        self.lines: int = self.function("lines")()
        self.inputs: int = self.function("inputs")()
        self._flags = np.ctypeslib.as_array(self.io.flags)
        self._edges = np.ctypeslib.as_array(self.io.edges)
        self._sent = np.ctypeslib.as_array(self.io.tx)
        self._readings = np.zeros((MAX_FRAMES, self.lines * self.inputs), np.uint16)
        self._readings_at = self._readings.ctypes.data

    def edge(self, signal: int, level: int, cycle: int) -> None:
        """Pass an edge of SYNC or INDEX; its frame must not be closed yet."""
        self.call("edge", signal, level, cycle)

    def receive(self, data: bytes) -> None:
        """Pass bytes from the host; the board reads them in its next frame."""
        self.call("receive", data, len(data))

    def run(self, readings: NDArray[np.uint16]) -> None:
        """Close and send frames with these readings, uint16 (n, lines × inputs), n ≤ MAX_FRAMES.

        Raises RigFault for readings of another sensor.
        """
        if readings.shape[1] != self.lines * self.inputs:
            raise RigFault(self._other_sensor(f"{readings.shape[1]} readings come"))
        n_frames = len(readings)
        self._readings[:n_frames] = readings
        self.call("run", self._readings_at, n_frames)

    def require(self, sensor: TaxelArray) -> None:
        """Raise ConfigError where the board was compiled for another sensor."""
        if (self.lines * self.inputs, self.inputs) != (sensor.count, sensor.inputs):
            raise ConfigError(
                self._other_sensor(
                    f"[taxels] of rig.toml has count = {sensor.count}, inputs = {sensor.inputs}"
                )
            )

    def _other_sensor(self, what: str) -> str:
        return (
            f"the virtual taxel board is compiled for {self.lines} lines × {self.inputs} inputs, "
            f"but {what}: let arduino/taxels/board.h and rig.toml describe the same sensor, then "
            f"run {COMMAND}"
        )

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
        return self._sent[:count].tobytes()


FRAME_US = 1000
CYCLES_PER_FRAME = 16_000
FLUSH_US = 20_000
"""Period in which the cable delivers bytes: the latency timer of common USB adapters."""

SEND_US = 700
"""Time from the end of a frame's samples to the frame's last byte."""

BOOT_US = 5_000
POWER_ON, EXTERNAL = 1, 2


class VirtualTaxels:
    """The taxel board from power-up on. Times are simulated microseconds.

    Without ``board``, the firmware runs: raises RigFault if its library cannot be used, ConfigError
    if it was compiled for another sensor than the bench has.
    """

    def __init__(self, bench: Bench, board: DriverBoard | None = None) -> None:
        self._bench = bench
        self.firmware = board or _firmware(bench.sensor)
        self.frame_us = FRAME_US / (1.0 + bench.parameters.taxel_clock_ppm * 1e-6)
        self._frames_since_power_up = 0
        self._boot(0, POWER_ON)

    def reset(self, now_us: int) -> None:
        """Press the reset button: the board's counters restart."""
        self._boot(now_us, EXTERNAL)

    def _boot(self, at_us: int, cause: int) -> None:
        self._origin_us = at_us + BOOT_US
        self._closed = 0
        self.firmware.boot(cause)
        self.set_sync(self._bench.sync_level, at_us)

    def set_sync(self, level: int, at_us: int) -> None:
        """Handle an edge of the sync line."""
        self.firmware.edge(SYNC, level, self._cycle(at_us))

    def set_index(self, level: int, at_us: int) -> None:
        """Handle an edge of the index mark's sensor."""
        self.firmware.edge(INDEX, level, self._cycle(at_us))

    def first_frame_from(self, at_us: float) -> int:
        """Return the number of the first frame that starts at or after a time."""
        return math.ceil((at_us - self._origin_us) / self.frame_us)

    def start_us(self, frame: int) -> float:
        """Return the time at which a frame starts."""
        return self._origin_us + frame * self.frame_us

    def ended_frames(self, now_us: float) -> int:
        """Return how many frames have ended by a time."""
        return int((now_us - self._origin_us) / self.frame_us)

    def send(self, now_us: int) -> bytes:
        """Send the frames whose last byte is out by now, and return the bytes."""
        due = self.ended_frames(now_us - SEND_US) - self._closed
        if due > 0:
            self._bench.skin.advance()
            self.firmware.run(self._readings(due))
        return self.firmware.take_sent()

    def read_frames(
        self, first: int, end: int
    ) -> tuple[NDArray[np.uint16], NDArray[np.uint8], NDArray[np.uint8]]:
        """Close frames up to ``end`` unsent; return samples, flags and edges from ``first`` on.

        uint16 (n, n_taxels), uint8 (n,), uint8 (n,). Callers read frames in ascending order.
        """
        assert isinstance(self.firmware, TaxelFirmware)
        self.firmware.close_frames(first - self._closed)
        self._closed = self._frames_since_power_up = first
        self._bench.skin.advance()
        samples = self._readings(end - first)
        return samples, *self.firmware.close_frames(end - first)

    def _readings(self, count: int) -> NDArray[np.uint16]:
        numbers = np.arange(self._closed, self._closed + count, dtype=np.float64)
        starts: NDArray[np.float64] = self._origin_us + numbers * self.frame_us
        slot_us = SLOT_US * self.frame_us / FRAME_US
        samples = self._bench.skin.read(self._frames_since_power_up, starts, slot_us)
        self._closed += count
        self._frames_since_power_up += count
        return samples

    def _cycle(self, at_us: int) -> int:
        return math.floor((at_us - self._origin_us) / self.frame_us * CYCLES_PER_FRAME)


def _firmware(sensor: TaxelArray) -> TaxelFirmware:
    firmware = TaxelFirmware()
    firmware.require(sensor)
    return firmware
