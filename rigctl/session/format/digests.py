"""Chain the digests of a session's rows: each digest covers a block of rows and all before it.

A digest is the SHA-256 of the digest before it, the place of the rows, and the rows as they are
stored. The first one of a part covers the part's description: attributes, texts and the types of
its data sets. So no row can be changed, exchanged, left out or added without another digest at
the end of the session. ``docs/reference/trust.md`` says what that proves.
"""

from __future__ import annotations

import hashlib
import json
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from rigctl.session.format.data_sets import TEXTS
from rigctl.session.format.table_rows import Row
from rigctl.session.hdf5_file import read_attributes, read_text

FIRST_DIGEST = "0" * 64
"""Stands for the digest before the first one of a session."""
DESCRIPTION = "/"
"""``table`` of the row that covers the part's description."""
PREVIOUS_DIGEST = "previous_digest"
"""Attribute of a part's root: the last digest of the part before it."""


def next_digest(
    previous: str, table: str, first_row: int, n_rows: int, rows: bytes | memoryview
) -> str:
    """Return the digest of ``rows`` as stored, little-endian in C order; SHA-256, hexadecimal."""
    digest = hashlib.sha256(f"{previous}{table}\n{first_row}\n{n_rows}\n".encode())
    digest.update(rows)
    return digest.hexdigest()


def describe_part(file: Any) -> bytes:
    """Return canonical JSON of all that an open part holds besides its rows.

    It has the root's attributes, both texts, and the type, the shape of a row and the attributes
    of each data set that grows. Raises what h5py raises, and ValueError for other attributes.
    """
    objects: dict[str, Any] = {}
    file.visititems(lambda name, node: objects.update({f"/{name}": _describe(node)}))
    texts = {path: read_text(file, path) for path, _ in TEXTS}
    described = {"attributes": read_attributes(file), "objects": objects, "texts": texts}
    return json.dumps(described, sort_keys=True, separators=(",", ":"), ensure_ascii=False).encode()


class DigestChain:
    """The digests of one part while it is written, after ``previous``, that of the part before."""

    def __init__(self, previous: str, description: bytes) -> None:
        self.last = previous
        self._n_rows: dict[str, int] = {}
        self._new: list[Row] = []
        self._add(DESCRIPTION, 0, 0, description)

    def add(self, table: str, rows: NDArray[Any]) -> None:
        """Cover rows that follow those covered so far; their type is the one in the file."""
        first = self._n_rows.get(table, 0)
        self._n_rows[table] = first + len(rows)
        self._add(table, first, len(rows), np.ascontiguousarray(rows).view(np.uint8).data)

    def take_rows(self) -> list[Row]:
        """Return the new rows of /digests, oldest first, and forget them."""
        taken, self._new = self._new, []
        return taken

    def _add(self, table: str, first_row: int, n_rows: int, rows: bytes | memoryview) -> None:
        self.last = next_digest(self.last, table, first_row, n_rows, rows)
        self._new.append((table.encode(), first_row, n_rows, self.last.encode()))


def _describe(node: Any) -> dict[str, Any]:
    attributes = read_attributes(node)
    if not isinstance(node, h5py.Dataset):
        return {"attributes": attributes}
    row = list(node.shape[1:])
    return {"attributes": attributes, "type": _type_name(node.dtype), "row": row}


def _type_name(dtype: np.dtype[Any]) -> Any:
    if dtype.names is None:
        return dtype.str
    return [[name, dtype[name].str] for name in dtype.names]
