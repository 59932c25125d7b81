"""Write the file that takes a damaged part's place."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from rigctl.errors import DiskFault, SessionError
from rigctl.session.format.data_sets import DIGESTS, LIBVER, build_empty_part
from rigctl.session.format.digests import (
    FIRST_DIGEST,
    PREVIOUS_DIGEST,
    DigestChain,
    describe_part,
)
from rigctl.session.hdf5_file import Attributes
from rigctl.session.read.part import PartReader
from rigctl.session.read.part_file import open_cut_part
from rigctl.session.read.unclosed_part import SUPERBLOCK_BYTES, closed_superblock
from rigctl.session.recover.prefix import READ_ROWS, SavedRows, savable_rows

SPARE_BYTES = 4 << 20
"""Room that a recovery leaves on the disk."""
RECOVERED_FROM = "recovered_from"
"""Attribute of a rewritten part: the place of the original in the session's folder."""
Attempt = tuple[int, int]
"""The id of a trial and the number of the attempt at it."""


def check_room(folder: Path, n_bytes: int) -> None:
    """Raise DiskFault where the disk is too full for new files of this size."""
    free = shutil.disk_usage(folder).free
    if free < n_bytes + SPARE_BYTES:
        raise DiskFault(
            f"recover writes {n_bytes / 1e6:.1f} MB to {folder} and its disk has room for "
            f"{free / 1e6:.1f} MB: make room; nothing was changed"
        )


def close_copy(source: Path, target: Path) -> None:
    """Copy an unclosed part; only its superblock changes, to that of a closed file."""
    with _new_file(target) as file, source.open("rb") as original:
        size = os.fstat(original.fileno()).st_size
        file.write(closed_superblock(original.read(SUPERBLOCK_BYTES), size))
        shutil.copyfileobj(original, file, 1 << 22)


def write_prefix(source: Path, target: Path, original: str) -> dict[str, SavedRows]:
    """Write what can be saved of a part into a new one with digests of its own.

    ``original``: the place of the damaged file. Return the rows that were saved.
    """
    part = PartReader(source, open_cut_part)
    try:
        saved = savable_rows(part)
        texts = part.text("/protocol_toml"), part.text("/rig_toml")
        attributes: Attributes = {**part.attributes, RECOVERED_FROM: original}
        with _new_file(target) as file:
            file.write(build_empty_part(part.layout, attributes, part.header.n_taxels, texts))
        _fill(part, target, saved)
    finally:
        part.close()
    return saved


def _fill(part: PartReader, target: Path, saved: dict[str, SavedRows]) -> None:
    """Append the saved rows, and their digests if the original had any."""
    file = h5py.File(target, "r+", libver=LIBVER)
    try:
        if part.has_digests:
            previous = str(part.attributes.get(PREVIOUS_DIGEST, FIRST_DIGEST))
            chain = DigestChain(previous, describe_part(file))
        else:
            chain = None
            del file[DIGESTS.path]
        for path, rows in saved.items():
            _copy_rows(part, file[path], path, rows.saved, chain)
        if chain is not None:
            digests = np.array(chain.take_rows(), DIGESTS.dtype)
            _append(file[DIGESTS.path], digests)
        file.flush()
        os.fsync(file.id.get_vfd_handle())
    except OSError as error:
        _let_go(file)
        raise _disk_fault(target, error) from error
    file.close()


def _copy_rows(
    part: PartReader, dataset: Any, path: str, n_rows: int, chain: DigestChain | None
) -> None:
    tables = {table.path: table for table in part.layout.tables}
    for start in range(0, n_rows, READ_ROWS):
        stored = part.stored_rows(path, start, min(n_rows, start + READ_ROWS))
        stored = tables[path].complete(stored) if path in tables else stored
        rows = np.ascontiguousarray(stored).astype(dataset.dtype, copy=False)
        _append(dataset, rows)
        if chain is not None:
            chain.add(path, rows)


def _append(dataset: Any, rows: Any) -> None:
    start = dataset.shape[0]
    dataset.resize(start + len(rows), axis=0)
    dataset[start:] = rows


def _let_go(file: Any) -> None:
    """Close a file that could not be written; HDF5 would write the rest again, and crash."""
    if os.name == "posix":
        null = os.open(os.devnull, os.O_RDWR)
        os.dup2(null, file.id.get_vfd_handle())
        os.close(null)
    file.close()


@contextmanager
def _new_file(path: Path) -> Iterator[Any]:
    """Open a new file for writing; sync it. Raises DiskFault, and then leaves no file."""
    path.unlink(missing_ok=True)  # left by a recovery that was killed
    try:
        with path.open("xb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        path.unlink(missing_ok=True)
        raise _disk_fault(path, error) from error
    except SessionError:
        path.unlink(missing_ok=True)
        raise


def _disk_fault(path: Path, error: OSError) -> DiskFault:
    return DiskFault(
        f"cannot write {path}: {error.strerror or error}; make room or choose another disk, the "
        "originals are unchanged"
    )
