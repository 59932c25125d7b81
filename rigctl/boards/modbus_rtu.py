"""Frames of Modbus RTU: unit, PDU and CRC; and how a reply is found among received bytes."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

MAX_FRAME_BYTES = 256
_READ, _WRITE, _READ_WRITE = 3, 16, 23
_HEAD_BYTES, _EXCEPTION_BYTES, _WRITE_REPLY_BYTES = 4, 5, 8


class CorruptFrame(ValueError):
    """A reply has its full length, but its CRC or its head is wrong."""


def _crc_table() -> NDArray[np.uint16]:
    """Return the CRC of each single byte for the polynomial of Modbus, low bit first."""
    table = np.arange(256, dtype=np.uint16)
    for _ in range(8):
        table = np.where(table & 1, table >> 1 ^ 0xA001, table >> 1)
    return table.astype(np.uint16)


_CRC_TABLE = _crc_table()


@njit(cache=True, nogil=True)
def crc(data: bytes) -> int:
    """Return CRC-16 of Modbus over serial line (V1.02, §6.2.2); 0 over a frame with its CRC."""
    value = 0xFFFF
    for byte in data:
        value = value >> 8 ^ _CRC_TABLE[(value ^ byte) & 0xFF]
    return value


def compile_crc() -> None:
    """Compile :func:`crc` or load it from the cache; later it would delay a heartbeat."""
    crc(b"")


def encode_frame(unit: int, pdu: bytes) -> bytes:
    """Return the frame of a request: unit, PDU, CRC low byte first."""
    body = bytes([unit]) + pdu
    return body + crc(body).to_bytes(2, "little")


def find_reply(data: bytes, unit: int) -> bytes | None:
    """Return the PDU of the first intact reply of ``unit``, also behind other bytes.

    Returns None while the reply is incomplete. Raises CorruptFrame if no reply in ``data`` is
    intact although the first has its full length.
    """
    first_end = 0
    start = data.find(unit)
    while start >= 0:
        length = _reply_length(data, start)
        end = start + length
        if length and end <= len(data) and crc(data[start:end]) == 0:
            return data[start + 1 : end - 2]
        first_end = first_end or (end if length else 0)
        start = data.find(unit, start + 1)
    if first_end and first_end <= len(data):
        raise CorruptFrame(f"no intact reply in {len(data)} bytes")
    return None


def _reply_length(data: bytes, start: int) -> int:
    """Return the length of the reply that begins at ``start``, 0 where no reply begins there."""
    if start + _HEAD_BYTES > len(data):
        return _HEAD_BYTES
    function = data[start + 1]
    if function & 0x80:
        return _EXCEPTION_BYTES
    if function == _WRITE:
        return _WRITE_REPLY_BYTES
    return 5 + data[start + 2] if function in (_READ, _READ_WRITE) else 0
