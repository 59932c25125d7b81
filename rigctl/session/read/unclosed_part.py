"""Make HDF5 read a part whose writer was killed as if the writer had closed it.

This is no reader of its own: h5py reads such a part from this map as it reads any other from its
file. HDF5's own mode for such a file is SWMR, in which it waits for a writer to repair what it
cannot read: for ever, if the file was also cut short. So the program maps the file copy-on-write
and replaces the superblock in the map by one that has no open writer and the file's real length;
damage is then an error at once. The file itself does not change. Superblock versions 2 and 3 and
their checksum: HDF5 File Format Specification 3.0, sections II.A and VIII (Jenkins' lookup3).
"""

from __future__ import annotations

import mmap
import struct
from pathlib import Path

SIGNATURE = b"\x89HDF\r\n\x1a\n"
SUPERBLOCK_BYTES = 48
CHECKSUM_AT = 44
FLAGS_AT = 11
FILE_LENGTH_AT = 28
_MASK = 0xFFFFFFFF
_A, _B, _C = range(3)
_MIX = (
    (4, (_A, _C, _B)),
    (6, (_B, _A, _C)),
    (8, (_C, _B, _A)),
    (16, (_A, _C, _B)),
    (19, (_B, _A, _C)),
    (4, (_C, _B, _A)),
)
_FINAL = (
    (14, (_C, _B)),
    (11, (_A, _C)),
    (25, (_B, _A)),
    (16, (_C, _B)),
    (4, (_A, _C)),
    (14, (_B, _A)),
    (24, (_C, _B)),
)


def map_as_closed(path: Path) -> mmap.mmap:
    """Map the file into memory, its superblock closed in the map only.

    Raises OSError for a file without a superblock of version 2 or 3.
    """
    with path.open("rb") as file:
        view = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_COPY)
    view[:SUPERBLOCK_BYTES] = _close_superblock(view[:SUPERBLOCK_BYTES], len(view))
    return view


def lookup3(data: bytes) -> int:
    """Return Bob Jenkins' hashlittle with start value 0, the checksum of HDF5's metadata."""
    words = [(0xDEADBEEF + len(data)) & _MASK] * 3
    while len(data) > 12:
        _add(words, data[:12])
        for bits, (x, y, z) in _MIX:
            words[x] = ((words[x] - words[y]) ^ _rotate_left(words[y], bits)) & _MASK
            words[y] = (words[y] + words[z]) & _MASK
        data = data[12:]
    _add(words, data.ljust(12, b"\0"))
    for bits, (x, y) in _FINAL:
        words[x] = ((words[x] ^ words[y]) - _rotate_left(words[y], bits)) & _MASK
    return words[_C]


def _add(words: list[int], block: bytes) -> None:
    for place, value in enumerate(struct.unpack("<3I", block)):
        words[place] = (words[place] + value) & _MASK


def _rotate_left(value: int, bits: int) -> int:
    return ((value << bits) | (value >> (32 - bits))) & _MASK


def _close_superblock(head: bytes, length: int) -> bytes:
    """Return the superblock without the flags of an open writer and with the file's length."""
    if len(head) < SUPERBLOCK_BYTES or not head.startswith(SIGNATURE) or head[8] not in (2, 3):
        raise OSError("the file is too short, or it is not HDF5")
    closed = bytearray(head[:CHECKSUM_AT])
    closed[FLAGS_AT] = 0
    closed[FILE_LENGTH_AT : FILE_LENGTH_AT + 8] = struct.pack("<Q", length)
    return bytes(closed) + struct.pack("<I", lookup3(bytes(closed)))
