"""Damage to the bytes of any file: bits, pages, lengths, numbers at their limits."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path
from random import Random

from tests.fuzz.kind import Mutation

PAGE = 4096
INTERESTING = (0, 1, 2, 0x7F, 0x80, 0xFF, 0x7FFF, 0x8000, 0xFFFF, 0x7FFFFFFF, 0x80000000, 2**32 - 1)
WIDE = (*INTERESTING, 2**40, 2**62, 2**63 - 1, 2**63, 2**64 - 1)
FORMATS = {1: "<B", 2: "<H", 4: "<I", 8: "<Q"}

Edit = Callable[[Random, bytearray], str]


def flip_bits(random: Random, data: bytearray) -> str:
    """Flip one to eight bits."""
    places = [random.randrange(8 * len(data)) for _ in range(random.choice((1, 1, 1, 2, 8)))]
    for place in places:
        data[place // 8] ^= 1 << place % 8
    return f"bits {places} flipped"


def set_number(random: Random, data: bytearray) -> str:
    """Put a number at its limit somewhere."""
    size = random.choice((1, 2, 4, 8))
    value = random.choice(WIDE) % 256**size
    at = random.randrange(max(1, len(data) - size + 1))
    data[at : at + size] = struct.pack(FORMATS[size], value)
    return f"{value} at {at}"


def truncate(random: Random, data: bytearray) -> str:
    """Cut the end off."""
    length = random.randrange(len(data))
    del data[length:]
    return f"cut to {length} bytes"


def zero_page(random: Random, data: bytearray) -> str:
    """Zero a page, as a disk that lost it."""
    at = random.randrange(len(data)) // PAGE * PAGE
    size = min(PAGE, len(data) - at)
    data[at : at + size] = bytes(size)
    return f"zeros from {at}"


def insert(random: Random, data: bytearray) -> str:
    """Insert bytes from another place, or at random."""
    at, count = random.randrange(len(data) + 1), random.choice((1, 2, 8, 64, 4096))
    start = random.randrange(len(data))
    piece = data[start : start + count] if random.random() < 0.5 else random.randbytes(count)
    data[at:at] = piece
    return f"{len(piece)} bytes inserted at {at}"


def delete(random: Random, data: bytearray) -> str:
    """Delete a few bytes."""
    at, count = random.randrange(len(data)), random.choice((1, 2, 8, 64, 4096))
    del data[at : at + count]
    return f"{count} bytes from {at} deleted"


def overwrite(random: Random, data: bytearray) -> str:
    """Copy bytes over other ones."""
    count = random.choice((1, 8, 64, 512))
    start, at = random.randrange(len(data)), random.randrange(len(data))
    piece = data[start : start + count]
    data[at : at + len(piece)] = piece
    return f"{len(piece)} bytes of {start} copied to {at}"


def extend(random: Random, data: bytearray) -> str:
    """Append bytes."""
    count = random.choice((1, 100, PAGE))
    data += random.randbytes(count)
    return f"{count} bytes appended"


EDITS: tuple[Edit, ...] = (
    *(flip_bits,) * 4,
    *(set_number,) * 2,
    truncate,
    zero_page,
    insert,
    delete,
    overwrite,
    extend,
)


MOST_BYTES = 64 << 20


def on_file(edit: Edit) -> Mutation:
    """Return an edit of bytes as a mutation of a file; an empty file gets a byte first."""

    def mutate(random: Random, path: Path) -> str:
        if path.stat().st_size > MOST_BYTES:
            return "nothing: a mutation before made the file huge"
        data = bytearray(path.read_bytes()) or bytearray(b"\0")
        done = edit(random, data)
        path.write_bytes(data)
        return done

    return mutate


BYTES: tuple[Mutation, ...] = tuple(map(on_file, EDITS))
