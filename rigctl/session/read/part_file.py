"""Find and open the files of a session's parts for reading."""

from __future__ import annotations

from pathlib import Path

import h5py

from rigctl.errors import SessionError
from rigctl.session.format import layout
from rigctl.session.format.annotated_arrays import read_attributes
from rigctl.session.format.data_sets import LIBVER
from rigctl.session.format.writer_lock import is_being_written
from rigctl.session.read.unclosed_part import map_as_closed

CACHE_BYTES = 256 << 10
"""HDF5's chunk cache for each data set: its default of 8 MiB adds up over a session's parts."""


def part_paths(folder: Path) -> list[Path]:
    """Return the files of the session's parts, in order. Raises SessionError if there are none."""
    parts = sorted(folder.glob(layout.PART_PATTERN))
    if not parts:
        raise SessionError(
            f"{folder} is not a session: it contains no part-0001.h5; give the folder that "
            "rigctl run or rigctl demo made"
        )
    return parts


def open_part(path: Path) -> h5py.File:
    """Open a part for reading, also while it grows or after its writer was killed.

    Raises SessionError for a damaged part, another layout version or another kind of file.
    """
    try:
        file = _open(path)
    except OSError as error:
        raise SessionError(f"{path} is damaged, HDF5 cannot open it: {error}") from error
    attributes = read_attributes(file)
    name, version = attributes.get("layout"), attributes.get("layout_version")
    if name == layout.LAYOUT and version == layout.LAYOUT_VERSION:
        return file
    file.close()
    if name != layout.LAYOUT:
        raise SessionError(f"{path} is an HDF5 file, but not a part of a rigctl session")
    raise SessionError(
        f"{path} has layout version {version}, this program reads {layout.LAYOUT_VERSION}: "
        "use the rigctl that recorded it"
    )


def _open(path: Path) -> h5py.File:
    """Open a closed part directly, a growing one in SWMR mode and an unclosed one through a map."""
    try:
        return h5py.File(path, "r", libver=LIBVER, rdcc_nbytes=CACHE_BYTES)
    except OSError as error:
        if "already open" not in str(error):
            raise
    if _is_growing(path):
        return h5py.File(path, "r", libver=LIBVER, swmr=True, rdcc_nbytes=CACHE_BYTES)
    return h5py.File(map_as_closed(path), "r", rdcc_nbytes=CACHE_BYTES)


def _is_growing(path: Path) -> bool:
    """Return whether a living writer appends to this part, which is then the session's last."""
    last = max(path.parent.glob(layout.PART_PATTERN))
    return path.name == last.name and is_being_written(path.parent)
