"""The drum's firmware in this process: one virtual board, and what it shares with the bench.

:class:`DrumExchange` mirrors ``arduino/host/drum/exchange.h``.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.simulation.boards.library import I32, I64, POINTER, FirmwareLibrary
from rigctl.wire.drum.register_table import POLL_BLOCK

MOST_BYTES, MOST_EDGES, MOST_POLL_WORDS = 8192, 4096, 64
SYNC, INDEX = 0, 1
DONE = 0

WORDS = (
    "potentiometer",
    "end_up",
    "end_down",
    "motor_jammed",
    "mark_length_steps",
    "mark_inverted",
    "poll_address",
    "poll_count",
    "attended",
    "conversion_due",
    "conversion_cycle",
    "conversion_counts",
    "state",
    "fault",
    "result",
    "changes",
    "sequence",
    "booted",
    "received_at",
    "sent_at",
    "tx_count",
    "edge_count",
    "overflows",
)
"""The whole numbers of the exchange, in order: the kernel finds them by their place."""

REALS = ("drive", "place")


class DrumExchange(ctypes.Structure):
    """What bench and board tell each other between two runs."""

    _fields_ = (
        *((name, I64) for name in WORDS),
        *((name, ctypes.c_double) for name in REALS),
        ("tx_cycle", I64 * MOST_BYTES),
        ("edge_cycle", I64 * MOST_EDGES),
        ("edge_signal", I64 * MOST_EDGES),
        ("edge_level", I64 * MOST_EDGES),
        ("tx", ctypes.c_uint8 * MOST_BYTES),
        ("poll_words", ctypes.c_uint16 * MOST_POLL_WORDS),
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

    ``words`` int64 (23,) and ``reals`` float64 (2,) are the exchange as compiled code sees it,
    named by :data:`WORDS` and :data:`REALS`; ``poll_words`` uint16 is the newest poll. Raises
    RigFault where its library cannot be used.
    """

    def __init__(self, library: Path | None = None) -> None:
        super().__init__("drum", DrumExchange, _SIGNATURES, library)
        self.exchange.poll_address, self.exchange.poll_count = POLL_BLOCK
        self.words: NDArray[np.int64] = self._view(0, len(WORDS), I64)
        reals_at = DrumExchange.drive.offset
        self.reals: NDArray[np.float64] = self._view(reals_at, len(REALS), ctypes.c_double)
        words_at = DrumExchange.poll_words.offset
        self.poll_words: NDArray[np.uint16] = self._view(words_at, POLL_BLOCK[1], ctypes.c_uint16)

    @property
    def addresses(self) -> tuple[int, int]:
        """Addresses of the functions ``run`` and ``poll``, for compiled code."""
        functions = (self.function(name) for name in ("run", "poll"))
        run, poll = (ctypes.cast(function, POINTER).value or 0 for function in functions)
        return run, poll

    def place(self, steps: int) -> None:
        """Turn the drum to ``steps`` behind the start of its index mark."""
        self.call("place", steps)

    def set_estop(self, level: int) -> None:
        """Give the emergency stop's wire a level; high is open. The board acts at once."""
        self.call("set_estop", level)

    def receive(self, data: bytes, cycle: int) -> None:
        """Put bytes of the host on the cable at a cycle."""
        self.call("receive", data, len(data), cycle)

    def take_sent(self) -> tuple[bytes, list[int]]:
        """Return the bytes sent since the last call, and the cycle at which each has left."""
        count = self.exchange.tx_count
        self.exchange.tx_count = 0
        return bytes(self.exchange.tx[:count]), list(self.exchange.tx_cycle[:count])

    def take_edges(self) -> list[tuple[int, int, int]]:
        """Return the edges since the last call: cycle, SYNC or INDEX, level."""
        x, count = self.exchange, self.exchange.edge_count
        x.edge_count = 0
        return [(x.edge_cycle[i], x.edge_signal[i], x.edge_level[i]) for i in range(count)]

    def write(self, address: int, words: Sequence[int]) -> int:
        """Write registers as a Modbus master would; returns DONE or a Modbus exception code."""
        data = b"".join(int(word).to_bytes(2, "big") for word in words)
        return int(self.call("write", address, len(words), data))

    def read(self, address: int, count: int) -> list[int]:
        """Read registers as a Modbus master would."""
        words = (ctypes.c_uint16 * count)()
        self.call("read", address, count, words)
        return list(words)

    def _view(self, offset: int, count: int, kind: type[ctypes._SimpleCData[Any]]) -> NDArray[Any]:
        memory = (kind * count).from_address(ctypes.addressof(self.exchange) + offset)
        return np.ctypeslib.as_array(memory)
