"""Single bits of the bytes of a session that carry data, by the structure of its files.

What carries none in a part or a log: rows of a chunk behind the last row of the data set, and
places of the file that no structure uses. ``writer.lock`` names a process that has ended,
``world.h5`` has no digests.
"""

from __future__ import annotations

from functools import lru_cache
from io import BytesIO
from itertools import pairwise
from pathlib import Path
from random import Random
from typing import Any, NamedTuple

import h5py
import numpy as np

from tests.fuzz.mutations.checksums import find_blocks

WITHOUT_DATA = ("writer.lock", "world.h5")
ROWS, TEXT, METADATA, PADDING, FREE = "rows", "texts", "metadata", "padding of chunks", "free space"
FREE_SPACE_LISTS = (b"FSHD", b"FSSE")
"""Say where a writer may put something; no reader looks at them."""
CARRIES_DATA = (ROWS, TEXT, METADATA)


class Region(NamedTuple):
    """Bytes [start, end) of a file and what they are."""

    start: int
    end: int
    kind: str


def flip_data_bit(random: Random, folder: Path) -> str:
    """Flip one bit of a byte that carries data, each byte of the folder with equal chance."""
    regions = [(path, region) for path in _files(folder) for region in carrying(path)]
    sizes = [region.end - region.start for _, region in regions]
    (path, region) = random.choices(regions, sizes)[0]
    at, bit = random.randrange(region.start, region.end), random.randrange(8)
    data = bytearray(path.read_bytes())
    data[at] ^= 1 << bit
    path.write_bytes(data)
    return f"bit {bit} of byte {at} flipped, in {region.kind} [{region.start}, {region.end})"


def count_bytes(folder: Path) -> dict[str, int]:
    """Return the number of bytes of each kind in a session's folder."""
    counts: dict[str, int] = {}
    for path in _files(folder):
        for region in regions(path):
            counts[region.kind] = counts.get(region.kind, 0) + region.end - region.start
    return counts


def carrying(path: Path) -> list[Region]:
    """Return the regions of a file that carry data."""
    return [region for region in regions(path) if region.kind in CARRIES_DATA]


def regions(path: Path) -> tuple[Region, ...]:
    """Return what every byte of a file is, in order."""
    data = path.read_bytes()
    if path.suffix != ".h5":
        return (Region(0, len(data), TEXT),)
    return _regions(data)


@lru_cache(maxsize=16)
def _regions(data: bytes) -> tuple[Region, ...]:
    names = (FREE, METADATA, TEXT, PADDING, ROWS)
    kinds = np.zeros(len(data), np.uint8)
    for block in find_blocks(data):
        is_free = data[block.start : block.start + 4] in FREE_SPACE_LISTS
        kinds[block.start : block.end] = names.index(FREE if is_free else METADATA)
    with h5py.File(BytesIO(data), "r") as file:
        found: list[Any] = []
        file.visititems(lambda _, node: found.append(node))
        for node in found:
            if isinstance(node, h5py.Dataset):
                for start, end, kind in _stored(node):
                    kinds[start:end] = names.index(kind)
    edges = [0, *(np.flatnonzero(np.diff(kinds)) + 1).tolist(), len(data)]
    return tuple(Region(start, end, names[kinds[start]]) for start, end in pairwise(edges))


def _stored(node: Any) -> list[Region]:
    """Return where the values of a data set are."""
    if node.chunks is None:
        start = node.id.get_offset()
        return [] if start is None else [Region(start, start + node.id.get_storage_size(), TEXT)]
    chunks: list[Any] = []
    node.id.chunk_iter(chunks.append)
    filtered = bool(node.id.get_create_plist().get_nfilters())
    row_bytes = int(np.prod(node.chunks[1:])) * node.dtype.itemsize
    found = []
    for chunk in chunks:
        used = min(node.chunks[0], node.shape[0] - chunk.chunk_offset[0]) * row_bytes
        end = chunk.byte_offset + chunk.size
        middle = end if filtered else chunk.byte_offset + max(0, used)
        found += [Region(chunk.byte_offset, middle, ROWS), Region(middle, end, PADDING)]
    return found


def _files(folder: Path) -> list[Path]:
    return sorted(p for p in folder.iterdir() if p.is_file() and p.name not in WITHOUT_DATA)
