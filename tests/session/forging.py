"""Rewrite a session's digests after its rows were changed, as somebody with the program could."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np

from rigctl.session.digests import DESCRIPTION, FIRST_DIGEST, describe_part, next_digest
from rigctl.session.hdf5_file import text_scalar
from rigctl.session.layout import DIGESTS
from rigctl.session.part import PREVIOUS_DIGEST


def rewrite_digests(folder: Path) -> str:
    """Make every digest agree with the present rows; return the new closing digest."""
    last = FIRST_DIGEST
    for path in sorted(folder.glob("part-*.h5")):
        last = _rewrite(path, last)
    return last


def _rewrite(path: Path, previous: str) -> str:
    with h5py.File(path, "r+") as file:
        file.attrs.create(PREVIOUS_DIGEST, text_scalar(previous))
        places = [(DESCRIPTION, 0, 0)]
        for row in file[DIGESTS.path][1:]:
            table, first = row["table"].decode(), int(row["first_row"])
            count = min(int(row["n_rows"]), len(file[table]) - first)
            places += [(table, first, count)] if count > 0 else []
        for table in _tables(file):
            covered = sum(count for name, _, count in places if name == table)
            if covered < len(file[table]):
                places.append((table, covered, len(file[table]) - covered))
        rows = []
        for table, first, count in places:
            data = (
                describe_part(file) if table == DESCRIPTION else _bytes(file, table, first, count)
            )
            previous = next_digest(previous, table, first, count, data)
            rows.append((table.encode(), first, count, previous.encode()))
        file[DIGESTS.path].resize(len(rows), axis=0)
        file[DIGESTS.path][:] = np.array(rows, file[DIGESTS.path].dtype)
    return previous


def _tables(file: h5py.File) -> list[str]:
    names: list[str] = []

    def visit(name: str, node: object) -> None:
        if isinstance(node, h5py.Dataset) and node.chunks and f"/{name}" != DIGESTS.path:
            names.append(f"/{name}")

    file.visititems(visit)
    return names


def _bytes(file: h5py.File, table: str, first: int, count: int) -> bytes:
    data: bytes = file[table][first : first + count].tobytes()
    return data
