"""Frames of Modbus RTU: the check that ends them, and how long the replies are."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

READ, WRITE_ONE, WRITE, READ_WRITE = 3, 6, 16, 23
SHORTEST = 4
_REFUSAL_BYTES, _ECHO_BYTES = 5, 8


def _crc_table() -> NDArray[np.uint16]:
    """CRC of each single byte, with the polynomial of Modbus, low bit first."""
    table = np.arange(256, dtype=np.uint16)
    for _ in range(8):
        table = np.where(table & 1, table >> 1 ^ 0xA001, table >> 1)
    return table.astype(np.uint16)


_CRC_TABLE = _crc_table()


@njit(cache=True, nogil=True)
def crc(data: bytes) -> int:
    """CRC-16 of Modbus over serial line (V1.02, §6.2.2); 0 over a frame with its own."""
    value = 0xFFFF
    for byte in data:
        value = value >> 8 ^ _CRC_TABLE[(value ^ byte) & 0xFF]
    return value


def framed(body: bytes) -> bytes:
    """``body`` with its CRC, low byte first."""
    return body + crc(body).to_bytes(2, "little")


def reply_bytes(data: bytes, start: int) -> int:
    """Length of the reply whose head stands at ``start``; 0 where none begins there."""
    if start + SHORTEST > len(data):
        return SHORTEST
    function = data[start + 1]
    if function & 0x80:
        return _REFUSAL_BYTES
    if function in (WRITE, WRITE_ONE):
        return _ECHO_BYTES
    return 5 + data[start + 2] if function in (READ, READ_WRITE) else 0


def warm() -> None:
    """Compile, or load what was compiled: later it would hold up a loop that beats a heart."""
    crc(b"")
