"""A part whose writer was killed, shown to HDF5 as if it had been closed in order.

HDF5's own way to open such a file is SWMR mode, in which it waits for a writer to mend whatever
it cannot read: for ever, if the file was also cut short. Here the superblock is replaced while
it is read, by one that says "closed" and names the file's real length, so that damage is an
error at once. The file itself is not touched. Superblock version 2 and 3 and its checksum:
HDF5 File Format Specification 3.0, sections II.A and VIII (Jenkins' lookup3).
"""

from __future__ import annotations

import io
import mmap
import struct
from pathlib import Path

SIGNATURE = b"\x89HDF\r\n\x1a\n"
SUPERBLOCK_BYTES = 48
CHECKED_BYTES = 44
FLAGS_AT = 11
END_AT = 28
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


class UnclosedPart(io.RawIOBase):
    """Reads the file at ``path`` with its superblock closed. Raises OSError for another file."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        with path.open("rb") as file:
            self._map = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        self._head = _closed(self._map[:SUPERBLOCK_BYTES], len(self._map))
        self._at = 0

    def readable(self) -> bool:
        """Always."""
        return True

    def seekable(self) -> bool:
        """Always."""
        return True

    def tell(self) -> int:
        """Where the next read begins."""
        return self._at

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        """Move to a place, counted from the start, from here or from the end."""
        base = {io.SEEK_SET: 0, io.SEEK_CUR: self._at, io.SEEK_END: len(self._map)}[whence]
        self._at = base + offset
        return self._at

    # h5py hands over these two kinds of buffer; RawIOBase declares every kind there is.
    def readinto(self, buffer: bytearray | memoryview) -> int:  # type: ignore[override]
        """Fill ``buffer`` from the file, the superblock from memory."""
        data = self._map[self._at : self._at + len(buffer)]
        if self._at < SUPERBLOCK_BYTES:
            data = (self._head + self._map[SUPERBLOCK_BYTES : self._at + len(buffer)])[self._at :]
            data = data[: len(buffer)]
        buffer[: len(data)] = data
        self._at += len(data)
        return len(data)


def lookup3(data: bytes) -> int:
    """Bob Jenkins' hashlittle with start value 0, as HDF5 checks its metadata with."""
    words = [(0xDEADBEEF + len(data)) & _MASK] * 3
    while len(data) > 12:
        _add(words, data[:12])
        for bits, (x, y, z) in _MIX:
            words[x] = ((words[x] - words[y]) ^ _rotated(words[y], bits)) & _MASK
            words[y] = (words[y] + words[z]) & _MASK
        data = data[12:]
    _add(words, data.ljust(12, b"\0"))
    for bits, (x, y) in _FINAL:
        words[x] = ((words[x] ^ words[y]) - _rotated(words[y], bits)) & _MASK
    return words[_C]


def _add(words: list[int], block: bytes) -> None:
    for place, value in enumerate(struct.unpack("<3I", block)):
        words[place] = (words[place] + value) & _MASK


def _rotated(value: int, bits: int) -> int:
    return ((value << bits) | (value >> (32 - bits))) & _MASK


def _closed(head: bytes, length: int) -> bytes:
    """The superblock without the flags of an open writer, ending where the file ends."""
    if len(head) < SUPERBLOCK_BYTES or not head.startswith(SIGNATURE) or head[8] not in (2, 3):
        raise OSError("the file is too short, or it is not HDF5")
    changed = bytearray(head[:CHECKED_BYTES])
    changed[FLAGS_AT] = 0
    changed[END_AT : END_AT + 8] = struct.pack("<Q", length)
    return bytes(changed) + struct.pack("<I", lookup3(bytes(changed)))
