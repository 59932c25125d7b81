"""Consistent overhead byte stuffing (COBS): bytes without zeros, so that a zero ends a frame.

Source: Cheshire and Baker,
*Consistent Overhead Byte Stuffing*, IEEE/ACM Transactions on Networking 7(2), 1999.
"""

from __future__ import annotations

LONGEST_RUN = 254


def encode(data: bytes) -> bytes:
    """Return ``data`` stuffed, without the closing zero."""
    out = bytearray()
    for run in data.split(b"\0"):
        rest = run
        while len(rest) >= LONGEST_RUN:
            out.append(LONGEST_RUN + 1)
            out += rest[:LONGEST_RUN]
            rest = rest[LONGEST_RUN:]
        out.append(len(rest) + 1)
        out += rest
    return bytes(out)


def decode(data: bytes) -> bytes:
    """Return the bytes of stuffed ``data``, which has no closing zero.

    Raises ValueError where ``data`` holds a zero or ends inside a run.
    """
    out = bytearray()
    at = 0
    while at < len(data):
        code = data[at]
        run = data[at + 1 : at + code]
        if code == 0 or 0 in run or len(run) != code - 1:
            raise ValueError(f"byte {at} of {len(data)} does not continue a COBS frame")
        out += run
        at += code
        if at < len(data) and code <= LONGEST_RUN:
            out.append(0)
    return bytes(out)
