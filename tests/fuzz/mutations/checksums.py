"""The blocks of HDF5's metadata, found in a whole file by their checksums.

HDF5 File Format Specification 3.0.
"""

from __future__ import annotations

import hashlib
import struct
from functools import lru_cache
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from rigctl.session.part import lookup3

SIGNATURES = (
    *(b"OHDR", b"OCHK", b"BTHD", b"BTIN", b"BTLF", b"FRHP", b"FHDB", b"FHIB", b"FSHD", b"FSSE"),
    *(b"FAHD", b"FADB", b"EAHD", b"EAIB", b"EASB", b"EADB", b"SMTB", b"SMLI"),
)
LONGEST = 4096
HEAP_BLOCK_SIZES = (512, 1024, 2048, 4096, 8192, 65536)


class Block(NamedTuple):
    """A block of metadata [start, end) with its checksum at ``checksum``."""

    start: int
    end: int
    checksum: int


def find_blocks(data: bytes) -> list[Block]:
    """Return the blocks of metadata whose checksums hold."""
    return list(_find_blocks(hashlib.sha256(data).digest(), data))


@lru_cache(maxsize=8)
def _find_blocks(_: bytes, data: bytes) -> tuple[Block, ...]:
    has_head = data[:4] == b"\x89HDF" and len(data) >= 48 and data[8] in (2, 3)
    blocks = [Block(0, 48, 44)] if has_head else []
    array = np.frombuffer(data + bytes(16), np.uint8)
    for signature in SIGNATURES:
        at = data.find(signature)
        while at >= 0:
            end = _block_end(array, at, min(len(data), at + LONGEST))
            if end:
                blocks.append(Block(at, end, end - 4))
            elif signature == b"FHDB":
                blocks += _heap_block(data, at)
            at = data.find(signature, at + 1)
    return tuple(sorted(blocks))


def _heap_block(data: bytes, at: int) -> list[Block]:
    for size in HEAP_BLOCK_SIZES:
        body = bytearray(data[at : at + size])
        for inside in range(14, 22):
            stored = bytes(body[inside : inside + 4])
            trial = body[:inside] + bytes(4) + body[inside + 4 :]
            if len(body) == size and struct.pack("<I", lookup3(bytes(trial))) == stored:
                return [Block(at, at + size, at + inside)]
    return []


@numba.njit(cache=True)
def _block_end(data: NDArray[np.uint8], start: int, limit: int) -> int:
    """Return the end of the block that begins here, behind its checksum; 0 without one."""
    for length in range(8, limit - start - 3):
        at = start + length
        stored = (
            np.uint32(data[at])
            | np.uint32(data[at + 1]) << np.uint32(8)
            | np.uint32(data[at + 2]) << np.uint32(16)
            | np.uint32(data[at + 3]) << np.uint32(24)
        )
        if stored == _lookup3(data, start, length):
            return at + 4
    return 0


@numba.njit(cache=True)
def _rotate(value: np.uint32, bits: int) -> np.uint32:
    return np.uint32((value << np.uint32(bits)) | (value >> np.uint32(32 - bits)))


@numba.njit(cache=True)
def _lookup3(data: NDArray[np.uint8], start: int, length: int) -> np.uint32:
    """Return lookup3 as :func:`rigctl.session.part.lookup3` does, compiled."""
    a = np.uint32(0xDEADBEEF + length)
    b = a
    c = a
    blocks = -(-length // 12)
    for block in range(blocks):
        words = np.zeros(3, np.uint32)
        for k in range(12):
            i = block * 12 + k
            if i < length:
                words[k // 4] |= np.uint32(data[start + i]) << np.uint32(8 * (k % 4))
        a = np.uint32(a + words[0])
        b = np.uint32(b + words[1])
        c = np.uint32(c + words[2])
        if block == blocks - 1:
            break
        for bits in (4, 6, 8, 16, 19, 4):
            a, b, c = b, np.uint32(c + b), np.uint32((a - c) ^ _rotate(c, bits))
    for bits in (14, 11, 25, 16, 4, 14, 24):
        a, b, c = b, np.uint32((c ^ b) - _rotate(b, bits)), a
    return b
