"""Find and open the files of a session's parts for reading."""

from __future__ import annotations

from pathlib import Path

from rigctl.errors import SessionError
from rigctl.session.format import layout
from rigctl.session.format.data_sets import LIBVER
from rigctl.session.format.writer_lock import is_being_written
from rigctl.session.hdf5.hdf5_file import Hdf5File, UnclosedFile
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


def open_part(path: Path) -> Hdf5File:
    """Open a part for reading, also while it grows or after its writer was killed.

    Raises SessionError for a damaged part, another layout version or another kind of file.
    """
    file = _open(path)
    try:
        _check_layout(file)
    except SessionError:
        file.close()
        raise
    return file


def _check_layout(file: Hdf5File) -> None:
    attributes = file.attributes()
    name, version = attributes.get("layout"), attributes.get("layout_version")
    if name != layout.LAYOUT:
        raise SessionError(f"{file.path} is an HDF5 file, but not a part of a rigctl session")
    if version != layout.LAYOUT_VERSION:
        raise SessionError(
            f"{file.path} has layout version {version}, this program reads "
            f"{layout.LAYOUT_VERSION}: use the rigctl that recorded it"
        )


def _open(path: Path) -> Hdf5File:
    """Open a closed part directly, a growing one in SWMR mode and an unclosed one through a map."""
    try:
        return Hdf5File(path, libver=LIBVER, rdcc_nbytes=CACHE_BYTES)
    except UnclosedFile:
        if _is_growing(path):
            return Hdf5File(path, swmr=True, libver=LIBVER, rdcc_nbytes=CACHE_BYTES)
    try:
        image = map_as_closed(path)
    except OSError as error:
        raise SessionError(f"{path} is damaged, HDF5 cannot open it: {error}") from error
    return Hdf5File(path, image=image, rdcc_nbytes=CACHE_BYTES)


def _is_growing(path: Path) -> bool:
    """Return whether a living writer appends to this part, which is then the session's last."""
    last = max(path.parent.glob(layout.PART_PATTERN))
    return path.name == last.name and is_being_written(path.parent)
