"""The drum's firmware in this process.

:class:`DrumIO` mirrors ``arduino/host/drum/drum_io.h``.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.bench.boards.firmware_library import I32, I64, POINTER, FirmwareLibrary
from rigctl.boards.drum_registers import POLL_BLOCK

MAX_BYTES, MAX_EDGES, MAX_POLL_WORDS = 8192, 4096, 64
SYNC, INDEX = 0, 1
ACCEPTED = 0

INTEGER_FIELDS = (
    "potentiometer",
    "end_up",
    "end_down",
    "motor_jammed",
    "direction",
    "steps_per_turn",
    "mark_length_steps",
    "mark_inverted",
    "poll_address",
    "poll_count",
    "heartbeat_on",
    "conversion_due",
    "conversion_cycle",
    "conversion_counts",
    "conversion_in_step",
    "state",
    "fault",
    "result",
    "change_count",
    "sample_sequence",
    "boot_cycle",
    "rx_end_cycle",
    "bridge_on",
    "stepper_on",
    "tx_count",
    "edge_count",
    "overflows",
)
"""The integers of :class:`DrumIO` in order; the kernel indexes them."""

FLOAT_FIELDS = ("step_size", "drive", "position")


class DrumIO(ctypes.Structure):
    """Inputs and outputs of the board."""

    _fields_ = (
        *((name, I64) for name in INTEGER_FIELDS),
        *((name, ctypes.c_double) for name in FLOAT_FIELDS),
        ("tx_cycle", I64 * MAX_BYTES),
        ("edge_cycle", I64 * MAX_EDGES),
        ("edge_signal", I64 * MAX_EDGES),
        ("edge_level", I64 * MAX_EDGES),
        ("tx", ctypes.c_uint8 * MAX_BYTES),
        ("poll_words", ctypes.c_uint16 * MAX_POLL_WORDS),
    )


_SIGNATURES: dict[str, tuple[Any, list[Any]]] = {
    "run": (None, [POINTER, I64]),
    "poll": (None, [POINTER, I64]),
    "place": (None, [POINTER, I64]),
    "set_estop": (None, [POINTER, I32]),
    "receive": (None, [POINTER, ctypes.c_char_p, I32, I64]),
    "write": (I32, [POINTER, I32, I32, ctypes.c_char_p]),
    "read": (None, [POINTER, I32, I32, POINTER]),
}


class DrumFirmware(FirmwareLibrary):
    """One drum board.

    ``arrays`` are views of ``io`` for compiled code: :data:`INTEGER_FIELDS` int64 (27,),
    :data:`FLOAT_FIELDS` float64 (3,) and the newest poll uint16 (40,). Raises RigFault if its
    library cannot be used.
    """

    def __init__(self, library: Path | None = None) -> None:
        super().__init__("drum", DrumIO, _SIGNATURES, library)
        self.io.poll_address, self.io.poll_count = POLL_BLOCK
        integers: NDArray[np.int64] = self._view("potentiometer", len(INTEGER_FIELDS), I64)
        floats: NDArray[np.float64] = self._view("step_size", len(FLOAT_FIELDS), ctypes.c_double)
        poll: NDArray[np.uint16] = self._view("poll_words", POLL_BLOCK[1], ctypes.c_uint16)
        self._sent: NDArray[np.uint8] = self._view("tx", MAX_BYTES, ctypes.c_uint8)
        self._sent_cycles: NDArray[np.int64] = self._view("tx_cycle", MAX_BYTES, I64)
        self.arrays = integers, floats, poll

    @property
    def addresses(self) -> tuple[int, int]:
        """Return the addresses of ``run`` and ``poll``, for compiled code."""
        functions = (self.function(name) for name in ("run", "poll"))
        run, poll = (ctypes.cast(function, POINTER).value or 0 for function in functions)
        return run, poll

    def place_drum(self, steps: int) -> None:
        """Turn the drum to ``steps`` behind the start of its index mark."""
        self.call("place", steps)

    def set_estop(self, level: int) -> None:
        """Set the level of the emergency stop's wire, high is open; the board acts immediately."""
        self.call("set_estop", level)

    def receive(self, data: bytes, cycle: int) -> None:
        """Put bytes from the host on the cable at a cycle."""
        self.call("receive", data, len(data), cycle)

    def take_sent(self) -> tuple[bytes, NDArray[np.int64]]:
        """Return the bytes sent since the last call, and the cycle at which each was complete.

        The cycles, int64 (n,), are the board's own memory, which its next run changes.
        """
        count = self.io.tx_count
        self.io.tx_count = 0
        return self._sent[:count].tobytes(), self._sent_cycles[:count]

    def take_edges(self) -> list[tuple[int, int, int]]:
        """Return the edges since the last call: cycle, SYNC or INDEX, level."""
        io, count = self.io, self.io.edge_count
        io.edge_count = 0
        return [(io.edge_cycle[i], io.edge_signal[i], io.edge_level[i]) for i in range(count)]

    def write(self, address: int, words: Sequence[int]) -> int:
        """Write registers like a Modbus master; return ACCEPTED or a Modbus exception code."""
        data = b"".join(int(word).to_bytes(2, "big") for word in words)
        return int(self.call("write", address, len(words), data))

    def read(self, address: int, count: int) -> list[int]:
        """Read registers like a Modbus master."""
        words = (ctypes.c_uint16 * count)()
        self.call("read", address, count, words)
        return list(words)

    def _view(self, first: str, count: int, kind: type[ctypes._SimpleCData[Any]]) -> NDArray[Any]:
        address = ctypes.addressof(self.io) + getattr(DrumIO, first).offset
        return np.ctypeslib.as_array((kind * count).from_address(address))
