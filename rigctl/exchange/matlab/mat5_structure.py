"""Check the structure of a MATLAB 5 file, so that SciPy reads no more than the file holds.

SciPy believes the sizes of cells, structures and texts and reserves memory for them, and follows
nested ones without a limit. Format: MAT-File Format, MathWorks, R2024a, chapter 1.
"""

from __future__ import annotations

import struct
import zlib
from math import prod

HEADER_BYTES = 128
_MAJOR_VERSION = 1
"""The version that every file of MATLAB 5 to 7 has in the last bytes of its header."""
UNPACKED_BYTES = 256 << 20
"""All variables together may need this much, or twice the file."""
DEEPEST = 32
_COMPRESSED, _MATRIX = 15, 14
_CELL, _STRUCTURE, _OBJECT, _SPARSE, _FUNCTION, _OPAQUE = 1, 2, 3, 5, 16, 17
_COMPLEX = 0x800
"""Flag of an array with an imaginary part."""
_NUMBERS = (*range(1, 8), 9, 12, 13, 16, 17, 18)
"""Types of numbers and letters: integers of 8 to 32 bits, single, double, 64 bits, Unicode."""
_NESTED = (_CELL, _STRUCTURE, _OBJECT)
_KINDS = range(_CELL, _FUNCTION)
"""The array types that SciPy reads: cells to unsigned integers of 64 bits."""


def check_mat5(content: bytes) -> None:
    """Raise ValueError for a file whose variables claim more than it can hold."""
    order = _check_header(content[:HEADER_BYTES])
    limit = max(2 * len(content), UNPACKED_BYTES)
    at, unpacked = HEADER_BYTES, 0
    view = memoryview(content)
    while at < len(content):
        kind, data, at = _element(view, at, order)
        if kind == _COMPRESSED:
            plain = memoryview(_unpack(data, limit - unpacked))
            unpacked += len(plain)
            kind, data, _ = _element(plain, 0, order)
        if kind == _MATRIX:
            unpacked += _check_matrix(data, order, limit, 0)
        if unpacked > limit:
            raise ValueError(f"its variables need {unpacked} bytes")


def _check_header(header: bytes) -> str:
    """Return the byte order that a header declares, as struct writes it."""
    if len(header) < HEADER_BYTES or b"\0" in header[:4] or header[126:] not in (b"IM", b"MI"):
        raise ValueError("it has no header of MATLAB 5")
    order = "<" if header[126:] == b"IM" else ">"
    major = struct.unpack_from(f"{order}H", header, 124)[0] >> 8
    if major != _MAJOR_VERSION:
        raise ValueError(f"it has version {major} of the format: save it with -v7 or -v7.3")
    return order


def _unpack(data: memoryview, most: int) -> bytes:
    plain = zlib.decompressobj().decompress(data, max(1, most) + 1)
    if len(plain) > most:
        raise ValueError(f"a variable unpacks to more than {most} bytes")
    return plain


def _element(view: memoryview, at: int, order: str) -> tuple[int, memoryview, int]:
    """Return type and data of the element at a byte, and the byte after it."""
    if at + 8 > len(view):
        raise ValueError("it ends in the middle of a variable")
    kind, size = struct.unpack_from(f"{order}2I", view, at)
    if kind >> 16:  # up to four bytes in the place of their length
        return kind & 0xFFFF, view[at + 4 : at + 4 + min(kind >> 16, 4)], at + 8
    end = at + 8 + size
    if end > len(view):
        raise ValueError("it ends in the middle of a variable")
    return kind, view[at + 8 : end], end if kind == _COMPRESSED else end + -size % 8


def _check_matrix(view: memoryview, order: str, limit: int, depth: int) -> int:
    """Return how many bytes an array needs at most. Raise ValueError for an impossible one."""
    if depth > DEEPEST:
        raise ValueError(f"its variables are nested more than {DEEPEST} deep")
    if not len(view):
        return 0
    _, flags, at = _element(view, 0, order)
    if len(flags) < 4:
        raise ValueError("a variable has no type")
    word = struct.unpack_from(f"{order}I", flags)[0]
    kind = word & 0xFF
    if kind in (_FUNCTION, _OPAQUE):
        raise ValueError("it holds MATLAB objects: save arrays of numbers alone")
    if kind not in _KINDS:
        raise ValueError(f"a variable has the unknown type {kind}")
    _, sizes, at = _element(view, at, order)
    shape = struct.unpack(f"{order}{len(sizes) // 4}i", sizes[: len(sizes) // 4 * 4])
    count: int = prod(shape)
    if min(shape, default=0) < 0 or (kind != _SPARSE and count > len(view)):
        raise ValueError(f"a variable claims the shape {shape} in {len(view)} bytes")
    _, _, at = _element(view, at, order)  # its name
    if kind not in _NESTED:
        parts = (3 if kind == _SPARSE else 1) + bool(word & _COMPLEX)
        _check_numbers(view, at, order, parts)
        return count * 8 if kind != _SPARSE else len(view) * 8
    return count * 64 + _check_members(view, at, order, kind, limit, depth)


def _check_numbers(view: memoryview, at: int, order: str, parts: int) -> None:
    """Check that all parts of an array are there, of known types.

    SciPy reads a missing part behind the variable, and finds a type in a table whose end it does
    not know.
    """
    for _ in range(parts):
        kind, _, at = _element(view, at, order)
        if kind not in _NUMBERS:
            raise ValueError(f"a variable has numbers of the unknown type {kind}")


def _check_members(view: memoryview, at: int, order: str, kind: int, limit: int, depth: int) -> int:
    """Check the arrays in a cell array or structure; return how many bytes they need."""
    header_elements = {_CELL: 0, _STRUCTURE: 2, _OBJECT: 3}[kind]
    for _ in range(header_elements):  # class, length of field names, field names
        _, _, at = _element(view, at, order)
    total = 0
    while at < len(view):
        member, data, at = _element(view, at, order)
        if member == _MATRIX:
            total += _check_matrix(data, order, limit, depth + 1)
        if total > limit:
            raise ValueError(f"its variables need more than {limit} bytes")
    return total
